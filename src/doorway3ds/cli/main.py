"""The command `3ds`. Each file in this folder is one command; only the one called is imported.

A command's module has either `app`, a Typer, or a function of its own name. Heavy imports stay
inside the functions, so that the command starts fast and works without the extras it does not use.
"""

from __future__ import annotations

import contextlib
import os
import pkgutil
import re
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

_HELP = ["-h", "--help"]

# In the order of `3ds --help`; other files in this folder follow by name.
_ORDER = (
    "look",
    "live",
    "serve",
    "run",
    "replay",
    "ros",
    "batch",
    "calibrate",
    "models",
    "bench",
    "label",
    "train",
    "qualify",
    "eval",
    "reproduce",
    "sim",
)

# Which extra brings a module that the default install does without.
_EXTRAS = {
    "fastapi": "serve",
    "fsspec": "batch",
    "h5py": "train",
    "keras": "train",
    "matplotlib": "report",
    "mujoco": "sim",
    "onnx": "train",
    "onnxscript": "train",
    "pydantic": "serve",
    "pyarrow": "batch",
    "qi": "nao",
    "ray": "ray",
    "rclpy": "ros",
    "rerun": "rerun",
    "rosbags": "bag",
    "torch": "train",
    "uvicorn": "serve",
}


def main() -> None:
    """Runs the command line and ends the process: 0 done, 1 not (all) done, 2 wrong call."""
    from doorway3ds.threads import end_all

    try:
        status = run(sys.argv[1:])
    except KeyboardInterrupt:
        status = 130
    if not end_all(1.0) or "qi" in sys.modules:
        # A driver that hangs, or a call that a robot never answered, would crash its thread while
        # Python ends; all is closed.
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)
    sys.exit(status)


def run(arguments: Sequence[str]) -> int:
    """Runs one command; returns its exit status."""
    from doorway3ds.cli.shared.output import OutputLost, complain, guarded_output
    from doorway3ds.cli.shared.viewer import with_viewer

    arguments = with_viewer(arguments)
    if sys.stderr is None:  # closed by whoever started this
        sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115
    # A name that the terminal's encoding lacks must not cost the answer.
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_: complain(str(message))
        warnings.filterwarnings("ignore", module=r"PIL\.")  # what matters of it is an error
        try:
            with guarded_output():
                return _run(arguments)
        except OutputLost as error:
            if isinstance(error.__cause__, BrokenPipeError):  # a reader that left, such as head
                return 1
            return _refuse(str(error), 1)


def _run(arguments: Sequence[str]) -> int:
    from typer.exceptions import TyperException

    from doorway3ds.errors import CallError, UserError

    try:
        ended = application(arguments).main(list(arguments), prog_name="3ds", standalone_mode=False)
        return ended if isinstance(ended, int) else 0
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1
    except TyperException as error:
        # In one line; empty where the help itself was the answer.
        message = " ".join(error.format_message().replace("Value error, ", "").split())
        return _refuse(message, error.exit_code) if message else error.exit_code
    except CallError as error:
        return _refuse(str(error), 2)
    except UserError as error:
        return _refuse(str(error), 1)
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get((error.name or "").partition(".")[0])
        if extra is None:
            raise
        hint = f"needs the extra '{extra}': pip install 'doorway3ds[{extra}]'"
        why = f"{error.name} is missing"
        if error.name == "qi":
            from doorway3ds.robots.nao.session import WHEELS

            why += f"; it exists for {WHEELS}"
        return _refuse(f"{' '.join(arguments[:1])} {hint} ({why})", 1)


def _refuse(message: str, status: int) -> int:
    from doorway3ds.cli.shared.output import complain

    complain(message)
    return status


def commands() -> list[str]:
    """Names of all commands that exist."""
    from doorway3ds import cli

    found = {m.name for m in pkgutil.iter_modules(cli.__path__) if not m.ispkg}
    found.discard("main")
    return [name for name in _ORDER if name in found] + sorted(found - set(_ORDER))


def application(arguments: Sequence[str]):  # type: ignore[no-untyped-def]  # Typer is imported late
    import typer

    app = typer.Typer(
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        help="One camera in, one safe turn out: open doorways, their direction, the way to them.",
    )

    def version(wanted: bool) -> None:
        if wanted:
            from doorway3ds import __version__

            typer.echo(f"doorway3ds {__version__}")
            raise typer.Exit

    @app.callback()
    def top(
        version: bool = typer.Option(
            False, "--version", callback=version, is_eager=True, help="Print the version and exit."
        ),
    ) -> None:
        pass

    names = commands()
    called = next((a for a in arguments if not a.startswith("-")), None)
    for name in [called] if called in names else names:
        module = import_module(f"doorway3ds.cli.{name}")
        if hasattr(module, "app"):
            app.add_typer(module.app, name=name)
        else:
            context = getattr(module, "CONTEXT", None)
            app.command(name, context_settings=context)(getattr(module, name))
    command = typer.main.get_command(app)
    _tidy(command)
    return command


def _tidy(command: Any) -> None:
    """Puts the help of a command and its subcommands right, before it is called."""
    command.context_settings = {**command.context_settings, "help_option_names": _HELP}
    command.help = _flowing(command.help or "")
    with command.make_context(command.name, [], resilient_parsing=True) as context:
        parameters = [*command.params, command.get_help_option(context)]
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""  # Typer names a flag's type, as if it took a value
        elif parameter.param_type_name == "argument":
            parameter.metavar = parameter.metavar or parameter.name.upper()
            parameter.display_type_rich = lambda ctx: None  # such as <list[str]>
    for inner in getattr(command, "commands", {}).values():
        _tidy(inner)


def _flowing(text: str) -> str:
    """Text whose paragraphs are one line each, left as they are where they are indented."""
    paragraphs = re.split(r"\n\s*\n", text.strip())
    return "\n\n".join(
        part if part.startswith(" ") else re.sub(r"\s*\n\s*", " ", part) for part in paragraphs
    )


if __name__ == "__main__":
    main()
