"""One URI, one source."""

from __future__ import annotations

import glob
import os
import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from doorway3ds.arguments import require, require_number
from doorway3ds.camera.model import Camera, Pose
from doorway3ds.errors import CallError, UserError
from doorway3ds.sources.address import without_password
from doorway3ds.sources.base import CameraFor, PoseOf, Source, View, require_view

# Sources in modules of their own, each with open_uri(uri, view, **options) -> Source.
_ELSEWHERE = {
    "bag": "doorway3ds.ros.bag",
    "nao": "doorway3ds.robots.nao.camera",
    "sim": "doorway3ds.lab.sim.robot.world",
}

_OPTIONS = frozenset({"pace", "loop", "fps", "patience_s", "stall_s", "stream", "capture"})

EXPECTED = (
    "an image, a folder, a pattern such as 'images/*.jpg', a video file, - (images on standard "
    "input), webcam://0, rtsp://, http:// (MJPEG), bag://, sim:// or nao://"
)


def open_source(
    uri: str | os.PathLike[str],
    *,
    camera: Camera | CameraFor | None = None,
    pose: Pose | PoseOf | None = None,
    **options: Any,
) -> Source:
    """Opens what a URI names: an image, a folder, a video, a webcam, a stream, a bag, a robot.

    >>> with open_source("examples/doorway.jpg") as source:
    ...     frame = next(source)
    >>> frame.image.shape, frame.camera.assumed
    ((480, 640, 3), True)

    Args:
        uri: as `3ds live` takes it, such as "webcam://0" or "walk.mp4".
        camera: outranks what the source knows of itself; a function may keep some of it.
        pose: likewise.
        options: pace (videos and folders come in their own time, as if live; default False: as fast
            as they are read), loop (start again at the end), fps (of a folder or standard input),
            patience_s (live: how long without an image until SourceLost, None: for ever);
            what a source has no use for is passed over.

    Returns:
        A context manager and iterator of `Frame`.

    Raises:
        UserError: for a URI that names no source, an argument of another kind, or if it cannot be
            opened (SourceLost for live ones).
    """
    require("uri", uri, (str, os.PathLike), "text or a path")
    require_view(camera, pose)
    if unknown := sorted(options.keys() - _OPTIONS):
        raise CallError(f"open_source has no option {', '.join(unknown)}")
    require_number("fps", options.get("fps"), 0.001, 1000, optional=True)
    require_number("patience_s", options.get("patience_s"), 0, optional=True)
    view, uri = View(camera, pose), os.fspath(uri)
    if not uri:
        raise CallError(f"uri is empty; expected {EXPECTED}")
    if uri == "-":
        from doorway3ds.sources.stills import StreamOfImages

        return StreamOfImages(view, **_only(options, "fps", "stream"))
    scheme = re.match(r"([A-Za-z][A-Za-z0-9+.-]*)://", uri)
    if scheme is not None:
        return _by_scheme(scheme[1].lower(), uri, view, options)
    return _by_path(uri, view, options)


def _by_scheme(scheme: str, uri: str, view: View, options: dict[str, Any]) -> Source:
    live = _only(options, "patience_s", "stall_s")
    if scheme in _ELSEWHERE:
        module = _ELSEWHERE[scheme]
        if find_spec(module) is None:
            raise UserError(f"{scheme}:// is not part of this version of doorway3ds")
        source: Source = import_module(module).open_uri(uri, view, **options)
        return source
    if scheme == "file":
        return _by_path(urlsplit(uri).path, view, options)

    from doorway3ds.sources.live import LiveSource

    name = without_password(uri)
    if scheme == "webcam":
        from doorway3ds.sources.capture import webcam

        return LiveSource(name, webcam(uri, options.get("capture")), view, **live)
    if scheme in ("rtsp", "rtsps"):
        from doorway3ds.sources.capture import stream

        return LiveSource(name, stream(uri), view, **live)
    if scheme in ("http", "https"):
        from doorway3ds.sources.mjpeg import mjpeg

        return LiveSource(name, mjpeg(uri), view, **live)
    raise CallError(f"{name}: no source is called {scheme}://; expected {EXPECTED}")


def _by_path(name: str, view: View, options: dict[str, Any]) -> Source:
    from doorway3ds.images.codec import SUFFIXES, is_image
    from doorway3ds.images.folder import images_in, natural
    from doorway3ds.sources.stills import Stills

    still = _only(options, "pace", "loop", "fps")
    path = Path(name)
    if path.is_dir():
        return Stills(name, images_in(path), view, **still)
    if path.is_file():
        # By what it holds, too: of a HEIC without its suffix FFmpeg would show one tile.
        if path.suffix.lower() in SUFFIXES or is_image(path):
            return Stills(name, [path], view, **still)
        from doorway3ds.sources.video import VideoFile

        return VideoFile(path, view, **_only(options, "pace", "loop"))
    if path.exists():
        raise UserError(f"{name} is a device or pipe; expected {EXPECTED}")
    if any(sign in name for sign in "*?["):
        paths = sorted(map(Path, glob.glob(name, recursive=True)), key=natural)  # noqa: PTH207
        if not paths:
            raise UserError(f"{name} matches no file; expected {EXPECTED}")
        return Stills(name, [found for found in paths if found.is_file()], view, **still)
    raise UserError(f"{name} does not exist; expected {EXPECTED}")


def _only(options: dict[str, Any], *names: str) -> dict[str, Any]:
    return {name: options[name] for name in names if name in options}
