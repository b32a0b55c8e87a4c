"""Shows the examples in docstrings as code: doctest takes them as plain paragraphs."""

import re
from typing import Any

import griffe

_EXAMPLE = re.compile(r"^>>> .*(?:\n.+)*", re.MULTILINE)


class Doctests(griffe.Extension):
    """Fences each paragraph that begins with a prompt."""

    def on_package(self, *, pkg: griffe.Module, **kwargs: Any) -> None:
        _fence(pkg)

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        _fence(obj)


def _fence(obj: griffe.Object) -> None:
    if obj.docstring and "```pycon" not in obj.docstring.value:
        obj.docstring.value = _EXAMPLE.sub(r"```pycon\n\g<0>\n```", obj.docstring.value)
