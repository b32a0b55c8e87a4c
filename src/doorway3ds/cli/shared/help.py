"""`--help` as people read it: flags without a value, lines that wrap once, -h."""

from __future__ import annotations

import re
from typing import Any

NAMES = ["-h", "--help"]


def tidy(command: Any) -> None:
    """Puts the help of a command and its subcommands right, before it is called."""
    command.context_settings = {**command.context_settings, "help_option_names": NAMES}
    command.help = flowing(command.help or "")
    with command.make_context(command.name, [], resilient_parsing=True) as context:
        parameters = [*command.params, command.get_help_option(context)]
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""  # Typer names a flag's type, as if it took a value
    for inner in getattr(command, "commands", {}).values():
        tidy(inner)


def flowing(text: str) -> str:
    """Text whose paragraphs are one line each, left as they are where they are indented."""
    paragraphs = re.split(r"\n\s*\n", text.strip())
    return "\n\n".join(
        part if part.startswith(" ") else re.sub(r"\s*\n\s*", " ", part) for part in paragraphs
    )
