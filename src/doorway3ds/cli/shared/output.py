"""Lines on standard error, and standard output that is full or closed: one line and status 1."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

from doorway3ds.errors import CallError

if TYPE_CHECKING:
    from rich.console import Console

    from doorway3ds.lab.evaluate.report.html import Table
    from doorway3ds.types import Reason


def say(line: str) -> None:
    """One line on standard error, at once."""
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


def complain(message: str) -> None:
    """What went wrong, in one line on standard error."""
    say(f"3ds: {message}")


def linked(words: str, reason: Reason | None, stream: TextIO) -> str:
    """The words, in a terminal as a link to what the documentation says of `reason`.

    Elsewhere, and in a terminal that shows no links, they are plain. None: of all reasons.
    """
    if not stream.isatty():
        return words
    from rich.console import Console
    from rich.text import Text

    from doorway3ds.draw.words import help_link

    console = Console(file=stream)
    with console.capture() as shown:
        console.print(Text(words, f"link {help_link(reason)}"), end="", soft_wrap=True)
    return shown.get()


def write_numbers(path: Path, numbers: Any) -> None:
    """Numbers as JSON, to standard output if the path is -."""
    from doorway3ds.files import write_json
    from doorway3ds.lab.evaluate.intervals import plain

    if str(path) == "-":
        sys.stdout.write(json.dumps(plain(numbers), allow_nan=False) + "\n")
    else:
        write_json(path, plain(numbers))


def apart(written: Mapping[str, Path | str | None], read: Iterable[Path | str | None] = ()) -> None:
    """CallError if what is written would replace what else is written, or what is read.

    written: files and new folders, by what the user calls them; None and - are none.
    """
    inputs = {Path(name).resolve() for name in read if name is not None}
    taken: list[tuple[str, Path]] = []
    for name, given in written.items():
        if given is None or str(given) == "-":
            continue
        path = Path(given).resolve()
        if path in inputs:
            raise CallError(f"{name} would replace {given}, which is read; name another file")
        for other, its in taken:
            if path == its:
                raise CallError(f"{other} and {name} are both {given}; name another file")
            if path in its.parents or its in path.parents:
                inner, outer = (name, other) if its in path.parents else (other, name)
                raise CallError(f"{inner} would lie in what {outer} writes; name another file")
        taken.append((name, path))


def report_files(option: str, folder: Path | None) -> dict[str, Path]:
    """What a report writes for certain, for `apart`."""
    names = () if folder is None else ("report.html", "report.json")
    return {f"{name} of {option}": Path(folder or "") / name for name in names}


class OutputLost(Exception):
    """Standard output takes nothing more. No UserError: no next image can be answered either."""


class _Guarded:
    """A text stream whose failed writes are OutputLost; all else is the stream's own."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except OSError as error:
            raise _lost(error) from error

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            raise _lost(error) from error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def guarded_output() -> Iterator[None]:
    """Within it, a failed write to `sys.stdout` raises OutputLost, also one that was buffered."""
    stream = sys.stdout
    if stream is None:
        raise OutputLost("standard output is closed; redirect it to a file or to /dev/null")
    sys.stdout = cast(TextIO, _Guarded(stream))
    try:
        yield
        sys.stdout.flush()
    except OutputLost:
        # What is still in the buffer must not fail again while Python ends.
        with contextlib.suppress(OSError, ValueError, AttributeError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
        raise
    finally:
        sys.stdout = stream


def _lost(error: OSError) -> OutputLost:
    return OutputLost(f"cannot write to standard output: {error.strerror or error}")


def quiet_decoders() -> None:
    """Keeps OpenCV and libav from writing warnings of their own for every hiccup of a stream."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def print_tables(console: Console, tables: Iterable[Table]) -> None:
    """Each table with its title, one row a line where the terminal is wide enough."""
    from rich.table import Table as RichTable

    for table in tables:
        # as a line of its own, as Rich wraps a title to its table's width
        console.print(table.title, style="italic", highlight=False, markup=False)
        shown = RichTable(box=None, pad_edge=False)
        shown.add_column("")
        for column in table.columns:
            shown.add_column(column)
        for name, _, cells in table.rows:
            shown.add_row(name, *cells)
        console.print(shown)
