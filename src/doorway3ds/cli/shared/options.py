"""From groups of settings, declared once, to the options of a command; and two by themselves."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, fields
from typing import Annotated, Any, get_type_hints

import typer

from doorway3ds.options import Options, Setting, check

# reproduce, eval
Network = Annotated[
    str, typer.Option(metavar="NAME[+NAME]", help="Network, one of `3ds models` or an .onnx file.")
]
Mirror = Annotated[
    bool,
    typer.Option("--mirror", help="Average over both mirrorings: steadier, at twice the time."),
]

_ANY = inspect.Parameter.KEYWORD_ONLY  # in whatever order, with or without a default


def expand(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameters of `Options` become one option for each of their settings.

    The command itself is called with the groups, made of what the user gave.

    Raises CallError, when it is called, for a number outside its bounds.
    """
    parameters: list[inspect.Parameter] = []
    groups: dict[str, type[Options]] = {}
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        kind = parameter.annotation
        if isinstance(kind, type) and issubclass(kind, Options):
            groups[name] = kind
            parameters += _options(kind)
        else:
            parameters.append(parameter.replace(kind=_ANY))

    @functools.wraps(command)
    def call(**given: Any) -> None:
        made = {}
        for name, kind in groups.items():
            values = {entry.name: given.pop(entry.name) for entry in fields(kind)}
            check(kind, values, _flag)
            made[name] = kind(**values)
        command(**given, **made)

    del call.__wrapped__  # Typer must not look behind it
    call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in parameters}
    return call


def _options(kind: type[Options]) -> list[inspect.Parameter]:
    hints = get_type_hints(kind)
    return [_parameter(entry, hints[entry.name], kind.panel) for entry in fields(kind)]


def _parameter(entry: Field[Any], kind: Any, panel: str) -> inspect.Parameter:
    known: Setting = entry.metadata["setting"]
    if entry.default is MISSING:
        raise TypeError(f"setting {entry.name} has no default")
    names = known.names or ((_flag(entry.name),) if kind is bool else ())
    option = typer.Option(*names, help=known.help, metavar=known.metavar, rich_help_panel=panel)
    return inspect.Parameter(
        entry.name,
        _ANY,
        default=entry.default,
        annotation=Annotated[kind, option],
    )


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
