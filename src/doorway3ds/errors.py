"""The one exception that people are meant to read."""

from __future__ import annotations


class UserError(Exception):
    """A mistake or circumstance the user can put right.

    Its message is one line: what was expected, what came, what to do. Commands print the
    message without a traceback.
    """
