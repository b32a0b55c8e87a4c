"""Cuts a stream of bytes into the image files that follow each other in it.

JPEG and PNG are followed through their own structure (ITU-T T.81 annex B, PNG 5.3), so that what
stands between images, such as the headers of a multipart stream, needs no agreement.
"""

from __future__ import annotations

import re

LARGEST = 64 << 20
_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"
_START = re.compile(re.escape(_JPEG) + b"|" + re.escape(_PNG))
# In the coded data of a scan FF is followed by 00 or a restart marker; anything else ends it. So
# does the next part of a multipart stream, where a server leaves the end marker out.
_AFTER_SCAN = re.compile(
    rb"\xff[^\x00\xd0-\xd7\xff]|\r?\n--[!-~]{1,72}\r?\n(?=[!-9;-~]{2,40}:)|\r?\n--[!-~]{1,72}--\r?\n"
)
_LONGEST_DELIMITER = 128
_SOI, _EOI, _SOS = 0xD8, 0xD9, 0xDA
_END = b"\xff\xd9"


class Splitter:
    """Feed it bytes as they come; each call returns the images that are now complete.

    Bytes that belong to no JPEG or PNG are dropped, and so is an image larger than `largest`
    bytes. One that breaks off is given as far as it goes, and one that lacks its end marker alone
    gets it: its decoder will refuse what is not whole.
    """

    def __init__(self, largest: int = LARGEST) -> None:
        self._largest = largest
        self._data = bytearray()
        self._at = 0  # how far the image at the start of the data is understood
        self._inside = False
        self._scan = False
        self._unended = False

    def feed(self, chunk: bytes) -> list[bytes]:
        self._data += chunk
        found: list[bytes] = []
        while True:
            if not self._inside and not self._begin():
                return found
            end = self._end_of_png() if self._data[0] == _PNG[0] else self._end_of_jpeg()
            if end is not None:
                found.append(bytes(self._data[:end]) + (_END if self._unended else b""))
                del self._data[:end]
            elif len(self._data) > self._largest:
                del self._data[: len(_JPEG)]
            else:
                return found
            self._inside = False

    def rest(self) -> list[bytes]:
        """What is left at the end of the stream: an image cut short, or nothing."""
        left = bytes(self._data) if self._inside else b""
        self._data.clear()
        self._inside = False
        return [left] if left else []

    def _begin(self) -> bool:
        """Moves the next image's first byte to the start of the data."""
        start = _START.search(self._data)
        if start is None:
            del self._data[: max(len(self._data) - len(_PNG) + 1, 0)]
            return False
        del self._data[: start.start()]
        self._inside, self._scan, self._unended = True, False, False
        self._at = 2 if self._data[0] == _JPEG[0] else len(_PNG)
        return True

    def _end_of_jpeg(self) -> int | None:
        """Where the image ends or breaks off; None: not yet."""
        data = self._data
        while True:
            if self._scan:
                marker = _AFTER_SCAN.search(data, self._at)
                if marker is None:
                    self._at = max(self._at, len(data) - _LONGEST_DELIMITER)
                    return None
                self._at, self._scan = marker.start(), False
                if data[self._at] != 0xFF:
                    self._unended = True
                    return self._at
            while self._at + 1 < len(data) and data[self._at] == data[self._at + 1] == 0xFF:
                self._at += 1  # fill bytes
            if self._at + 2 > len(data):
                return None
            if data[self._at] != 0xFF or data[self._at + 1] == _SOI:
                return self._at  # no marker, or the next image begins
            kind = data[self._at + 1]
            if kind == _EOI:
                return self._at + 2
            if self._at + 4 > len(data):
                return None
            length = int.from_bytes(data[self._at + 2 : self._at + 4], "big")
            if self._at + 2 + length > len(data):
                return None
            self._at += 2 + length
            self._scan = kind == _SOS

    def _end_of_png(self) -> int | None:
        data = self._data
        while self._at + 12 <= len(data):
            length = int.from_bytes(data[self._at : self._at + 4], "big")
            if length > self._largest:
                return self._at
            end = self._at + 12 + length
            if end > len(data):
                return None
            if data[self._at + 4 : self._at + 8] == b"IEND":
                return end
            self._at = end
        return None
