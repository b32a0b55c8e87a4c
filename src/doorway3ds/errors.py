"""The exceptions that people are meant to read."""

from __future__ import annotations


class UserError(Exception):
    """A mistake or circumstance the user can put right.

    Its message is one line: what was expected, what came, what to do. Commands print the
    message without a traceback and end with status 1.

    >>> from doorway3ds import open_source
    >>> try:
    ...     open_source("missing.mp4")
    ... except UserError as error:
    ...     print(str(error).partition(";")[0])
    missing.mp4 does not exist
    """


class CallError(UserError, ValueError):
    """The call itself is wrong (an option, an argument, a name, a combination): status 2."""
