"""What the C libraries under the decoders write to standard error, past Python."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import IO


class NativeErrors:
    """Keeps file descriptor 2 from libjpeg, libpng and OpenCV, whose lines name no file.

    Not for a process with other threads that write there.
    """

    def __init__(self) -> None:
        from tempfile import TemporaryFile

        self._file: IO[bytes] | None = None
        with contextlib.suppress(OSError):  # nowhere to write: the lines go where they went
            self._file = TemporaryFile()  # noqa: SIM115  # lives as long as the process

    @contextlib.contextmanager
    def collect(self) -> Iterator[list[str]]:
        """Gives a list that holds, after the block, the different lines written during it."""
        lines: list[str] = []
        saved = None
        with contextlib.suppress(OSError, AttributeError):  # started without a standard error
            sys.stderr.flush()
            saved = os.dup(2)
        if self._file is None or saved is None:
            yield lines
            return
        os.dup2(self._file.fileno(), 2)
        try:
            yield lines
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            self._file.seek(0)
            text = self._file.read().decode(errors="replace")
            self._file.seek(0)
            self._file.truncate()
            lines += dict.fromkeys(line.strip() for line in text.splitlines() if line.strip())
