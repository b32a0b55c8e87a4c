"""From groups of settings, declared once, to the options of a command; and two by themselves."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import Field, fields
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
    """A command whose settings become options: those of its parameters of `Options`, one by one,
    and its parameters that are a `setting` themselves.

    The command itself is called with the groups, made of what the user gave.

    Raises CallError, when it is called, for a number outside its bounds.
    """
    parameters: list[inspect.Parameter] = []
    groups: dict[str, type[Options]] = {}
    known: dict[str, Setting] = {}
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        kind = parameter.annotation
        if isinstance(kind, type) and issubclass(kind, Options):
            groups[name] = kind
            inner = get_type_hints(kind)
            entries = [(entry.name, inner[entry.name], entry) for entry in fields(kind)]
            panel = kind.panel
        elif isinstance(parameter.default, Field):
            entries, panel = [(name, kind, parameter.default)], None
        else:
            parameters.append(parameter.replace(kind=_ANY))
            continue
        for entry_name, entry_kind, entry in entries:
            known[entry_name] = entry.metadata["setting"]
            parameters.append(_parameter(entry_name, entry_kind, entry, panel))

    @functools.wraps(command)
    def call(**given: Any) -> None:
        for name, one in known.items():
            check(_flag(name), given[name], one)
        made = {
            name: kind(**{entry.name: given.pop(entry.name) for entry in fields(kind)})
            for name, kind in groups.items()
        }
        command(**given, **made)

    del call.__wrapped__  # Typer must not look behind it
    call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in parameters}
    return call


def _parameter(name: str, kind: Any, entry: Field[Any], panel: str | None) -> inspect.Parameter:
    known: Setting = entry.metadata["setting"]
    option = typer.Option(
        *(known.names or ((_flag(name),) if kind is bool else ())),
        help=known.help, metavar=known.metavar, envvar=known.envvar, rich_help_panel=panel,
    )  # fmt: skip
    return inspect.Parameter(name, _ANY, default=entry.default, annotation=Annotated[kind, option])


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
