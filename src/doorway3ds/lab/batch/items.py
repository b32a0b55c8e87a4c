"""What a batch is made of: images in folders, lists, archives, tables and films, near or far.

Items are found lazily and name where their bytes lie, so that a million of them cost no memory and
the process that decides is the one that reads.
"""

from __future__ import annotations

import glob
import os
import re
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from doorway3ds.errors import CallError, UserError
from doorway3ds.images.codec import MAX_BYTES, SUFFIXES
from doorway3ds.types import Frame

LISTS = (".txt", ".lst")
SHARDS = (".tar", ".tar.gz", ".tgz")
_SCHEME = re.compile(r"([a-z][a-z0-9+.-]*)://", re.IGNORECASE)
# Schemes that are files somewhere; others are cameras, robots and bags.
_REMOTE = ("s3", "gs", "gcs", "http", "https", "file", "memory", "abfs", "az", "hf")
_BRACES = re.compile(r"\{(\d+)\.\.(\d+)\}")


@dataclass(frozen=True)
class Item:
    """One image of a batch.

    name: what its row is called. occurrence: how many earlier items have the same name.
    url, offset, size: where its bytes lie; size None: the whole file.
    data: the bytes themselves, if their archive can only be read in order.
    frame: a decoded frame of a film or bag.
    """

    name: str
    occurrence: int = 0
    url: str | None = None
    offset: int = 0
    size: int | None = None
    data: bytes | None = None
    frame: Frame | None = None

    def read(self) -> bytes:
        """The bytes of the image file. Raises UserError if they cannot be read."""
        if self.data is not None:
            return self.data
        assert self.url is not None, "a frame has no file"
        try:
            with open_url(self.url) as file:
                if self.offset:
                    file.seek(self.offset)
                data: bytes = file.read(MAX_BYTES + 1 if self.size is None else self.size)
        except FileNotFoundError as error:
            raise UserError(f"{self.name} does not exist; expected an image file") from error
        # File systems of fsspec raise their clients' own exceptions.
        except Exception as error:
            raise UserError(f"{self.name} cannot be read: {_reason(error)}") from error
        if len(data) > MAX_BYTES:
            raise UserError(f"{self.name} is too large: over {MAX_BYTES >> 20} MiB")
        return data


def open_url(url: str) -> Any:
    """A readable binary file, local or on any file system that fsspec knows."""
    if _SCHEME.match(url) is None:
        return Path(url).open("rb")
    import fsspec

    return fsspec.open(url, "rb").open()


def find_items(sources: list[str]) -> Iterator[Item]:
    """Every image of the sources, in a fixed order.

    sources: image files, folders (read recursively), patterns, lists of names (.txt, one a line),
    tar archives (`shard-{000..010}.tar` counts up), Parquet files with image bytes, films, bags,
    and URLs of all but the last two.

    Raises CallError for a source that does not exist or is a live camera, UserError if an archive
    or table cannot be read.
    """
    seen: dict[int, int] = {}
    for item in _found([one for source in sources for one in _counted_up(source)]):
        key = hash(item.name)
        occurrence = seen.get(key, 0)
        seen[key] = occurrence + 1
        yield item if occurrence == 0 else replace(item, occurrence=occurrence)


def count_items(sources: list[str]) -> int | None:
    """How many images the sources hold; None if only reading them all would tell."""
    if not all(_cheap(one) for source in sources for one in _counted_up(source)):
        return None
    try:
        return sum(1 for _ in find_items(sources))
    except UserError:  # said by whoever decides on them
        return None


def _cheap(source: str) -> bool:
    listed = source.lower().endswith((*LISTS, ".tar")) or Path(source).suffix.lower() in SUFFIXES
    return listed or _remote(source) or _pattern(source) or Path(source).is_dir()


def _found(sources: list[str]) -> Iterator[Item]:
    for source in sources:
        if _SCHEME.match(source) is None and not (Path(source).exists() or _fitting(source)):
            raise CallError(
                f"{source} does not exist; expected an image, folder, pattern, .txt list, .tar, "
                f".parquet, film or URL"
            )
    for source in sources:
        yield from _items_of(source)


def _items_of(source: str) -> Iterator[Item]:
    lower = source.lower()
    if lower.endswith(LISTS):
        for line in _lines(source):
            holds = line.lower().endswith((*SHARDS, ".parquet", "/"))
            yield from _items_of(line) if holds else [Item(line, url=line)]
    elif lower.endswith(SHARDS):
        yield from _members(source)
    elif lower.endswith(".parquet"):
        yield from _table(source)
    elif Path(lower).suffix in SUFFIXES and not _pattern(source):
        yield Item(source, url=source)
    elif _remote(source):
        yield from _remote_images(source)
    elif _SCHEME.match(source) is None and Path(source).is_dir():
        yield from _folder(source)
    elif _SCHEME.match(source) is None and _pattern(source):
        for name in _fitting(source):
            if Path(name).suffix.lower() in SUFFIXES:
                yield Item(name, url=name)
    else:
        yield from _frames(source)


def _folder(folder: str) -> Iterator[Item]:
    """Images below a folder in name order; hidden files and folders are left out."""

    def refuse(error: OSError) -> None:
        raise UserError(f"{error.filename} cannot be read: {error.strerror}") from error

    for root, folders, files in os.walk(folder, onerror=refuse):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            if Path(name).suffix.lower() in SUFFIXES and not name.startswith("."):
                path = os.path.join(root, name)  # noqa: PTH118  # millions of them: no Path each
                yield Item(path, url=path)


def _lines(source: str) -> Iterator[str]:
    try:
        with open_url(source) as file:
            for line in file:
                name = line.decode("utf-8").strip()
                if name and not name.startswith("#"):
                    yield name
    except UnicodeDecodeError as error:
        raise UserError(f"{source} is not a list of names: expected UTF-8, one a line") from error
    except OSError as error:
        raise UserError(f"{source} cannot be read: {_reason(error)}") from error


def _members(source: str) -> Iterator[Item]:
    """Images of a tar archive; of an uncompressed one only the headers are read here."""
    plain = source.lower().endswith(".tar")
    try:
        with (
            open_url(source) as file,
            tarfile.open(fileobj=file, mode="r:" if plain else "r|gz") as tar,
        ):
            for member in tar:
                if not member.isfile() or Path(member.name).suffix.lower() not in SUFFIXES:
                    continue
                name = f"{source}/{member.name}"
                if plain:
                    yield Item(name, url=source, offset=member.offset_data, size=member.size)
                elif (inside := tar.extractfile(member)) is not None:
                    yield Item(name, data=inside.read(MAX_BYTES + 1))
    except (tarfile.TarError, EOFError, OSError) as error:
        raise UserError(
            f"{source} is not a tar archive that can be read: {_reason(error)}"
        ) from error


def _table(source: str) -> Iterator[Item]:
    """Rows of a Parquet file: its first column of bytes, or of {bytes, path} as data sets have."""
    import pyarrow
    import pyarrow.parquet

    try:
        with open_url(source) as file:
            table = pyarrow.parquet.ParquetFile(file)
            column, get, named = _columns(source, table.schema_arrow)
            columns = [column] if named is None else [column, named]
            row = 0
            for batch in table.iter_batches(batch_size=64, columns=columns):
                for values in batch.to_pylist():
                    name = values[named] if named else None
                    data = get(values[column])
                    yield Item(f"{source}/{name if name else row}", data=data or b"")
                    row += 1
    except (pyarrow.ArrowException, OSError) as error:
        raise UserError(
            f"{source} is not a Parquet file that can be read: {_reason(error)}"
        ) from error


def _columns(source: str, schema: Any) -> tuple[str, Callable[[Any], bytes | None], str | None]:
    """The column of images, how its values become bytes, and the column of names or None."""
    import pyarrow

    names = ("path", "name", "image_path", "file_name", "filename", "__key__", "key")
    named = next((name for name in names if name in schema.names), None)
    for field in schema:
        if pyarrow.types.is_binary(field.type) or pyarrow.types.is_large_binary(field.type):
            return field.name, lambda value: value, named
        if pyarrow.types.is_struct(field.type) and field.type.get_field_index("bytes") >= 0:
            return field.name, lambda value: (value or {}).get("bytes"), named
    raise UserError(
        f"{source} has no column of image bytes; expected binary or a struct with `bytes`, "
        f"got {', '.join(schema.names)}"
    )


def _remote_images(source: str) -> Iterator[Item]:
    """Images below a URL, or those that a pattern fits."""
    import fsspec

    try:
        system, path = fsspec.core.url_to_fs(source)
        paths = system.glob(path) if _pattern(source) else system.find(path)
    except Exception as error:
        raise UserError(f"{source} cannot be listed: {_reason(error)}") from error
    images = sorted(found for found in paths if Path(found).suffix.lower() in SUFFIXES)
    if not images:
        raise UserError(f"{source} holds no image")
    for found in images:
        url = system.unstrip_protocol(found)
        yield Item(url, url=url)


def _frames(source: str) -> Iterator[Item]:
    from doorway3ds.sources import open_source

    with open_source(source) as frames:
        if frames.live:
            raise CallError(f"{source} is live and has no end; watch it with: 3ds live {source}")
        for index, frame in enumerate(frames):
            yield Item(f"{source}#{index}", frame=frame)


def _counted_up(source: str) -> list[str]:
    """`shard-{000..003}.tar` as four names."""
    found = _BRACES.search(source)
    if found is None or Path(source).exists():
        return [source]
    low, high = found[1], found[2]
    numbers = range(int(low), int(high) + 1)
    return [
        one
        for number in numbers
        for one in _counted_up(source.replace(found[0], f"{number:0{len(low)}d}", 1))
    ]


def _fitting(pattern: str) -> list[str]:
    return [] if not _pattern(pattern) else sorted(glob.glob(pattern, recursive=True))  # noqa: PTH207  # absolute ones, too


def _pattern(source: str) -> bool:
    return any(sign in source for sign in "*?[") and not Path(source).exists()


def _remote(source: str) -> bool:
    scheme = _SCHEME.match(source)
    return scheme is not None and scheme[1].lower() in _REMOTE


def _reason(error: BaseException) -> str:
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return str(text).splitlines()[0][:200]
