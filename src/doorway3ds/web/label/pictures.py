"""The images of a folder by number: listed once, decoded when somebody looks at them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError
from doorway3ds.images.codec import SUFFIXES, Picture, encode_jpeg, read_image
from doorway3ds.images.folder import images_in
from doorway3ds.web.label.marks import Marks

MAX_SIDE = 1600  # of the copy that a browser gets
_KEPT = 24  # prepared images
# Beside images lie their labels of other kinds, in the layouts that `3ds eval` reads.
_NO_PICTURES = frozenset({"depth", "labels", "floor", "3ds-out"})


@dataclass(frozen=True)
class Guess:
    """What the network would mark, and the probability of an open doorway that it gives."""

    marks: Marks
    p_open: float


Guesser = Callable[[Picture], Guess]


@dataclass(frozen=True)
class Prepared:
    """One image as the page shows it. width, height: its own, upright; jpeg: a copy.

    guess: None without a network, or where it cannot answer, which `problem` then says.
    """

    width: int
    height: int
    jpeg: bytes
    guess: Guess | None = None
    problem: str | None = None


class Pictures:
    """The images below a folder (those in images/, where it has such a folder) in name order.

    names: as `doorways.csv` has them. left_out: files whose names it cannot hold.

    Raises UserError if there is none.
    """

    def __init__(self, folder: Path, guesser: Guesser | None = None) -> None:
        if not folder.is_dir():
            raise UserError(f"expected a folder of images, got {folder}")
        root = folder / "images"
        found = _below(root) if root.is_dir() else []
        if not found:
            root, found = folder, _below(folder)
        if not found:
            raise UserError(
                f"{folder} holds no image; expected .jpg, .png, .webp, .tif, .bmp or .ppm"
            )
        self.folder = folder
        self.root = root
        self.names = tuple(sorted(name for name in found if _writable(name)))
        self.left_out = tuple(sorted(name for name in found if not _writable(name)))
        self.unreadable: set[int] = set()
        self._guesser = guesser
        self._prepared: OrderedDict[tuple[int, str], Prepared] = OrderedDict()

    def __len__(self) -> int:
        return len(self.names)

    @property
    def guesses(self) -> bool:
        return self._guesser is not None

    def path(self, number: int) -> Path:
        return self.root / self.names[number]

    def place(self, number: int) -> str:
        """The folder that an image lies in, which tells its place; nothing at the top."""
        return self.names[number].rpartition("/")[0].strip()

    def version(self, number: int) -> str:
        """Changes with the image's file, so that browsers can keep copies."""
        try:
            found = self.path(number).stat()
        except OSError:
            return "gone"
        return f"{found.st_mtime_ns:x}-{found.st_size:x}-{found.st_ino:x}"

    def prepare(self, number: int) -> Prepared:
        """Decodes an image and asks the network; the newest are kept. For one thread alone.

        Raises UserError if it cannot be read.
        """
        key = (number, self.version(number))
        if key not in self._prepared:
            try:
                picture = read_image(self.path(number), name=self.names[number])
            except UserError:
                self.unreadable.add(number)
                raise
            self.unreadable.discard(number)
            self._prepared[key] = self._show(picture)
            while len(self._prepared) > _KEPT:
                self._prepared.popitem(last=False)
        self._prepared.move_to_end(key)
        return self._prepared[key]

    def _show(self, picture: Picture) -> Prepared:
        height, width = picture.image.shape[:2]
        jpeg = _small_jpeg(picture.image)
        if self._guesser is None:
            return Prepared(width, height, jpeg)
        try:
            return Prepared(width, height, jpeg, self._guesser(picture))
        except UserError as error:
            return Prepared(width, height, jpeg, problem=str(error))


def _below(root: Path) -> list[str]:
    """Images in the folders under `root` that hold no labels of other kinds, by relative name."""
    found = (path.relative_to(root) for path in images_in(root, recursive=True))
    return [
        path.as_posix()
        for path in found
        if path.suffix.lower() in SUFFIXES and not _NO_PICTURES.intersection(path.parts[:-1])
    ]


def _writable(name: str) -> bool:
    """Whether a name survives a CSV file: readable as UTF-8, without blanks round it."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return name == name.strip() and name.isprintable()


def _small_jpeg(image: NDArray[np.uint8]) -> bytes:
    height, width = image.shape[:2]
    scale = min(1.0, MAX_SIDE / max(width, height))
    if scale < 1:
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return encode_jpeg(image)
