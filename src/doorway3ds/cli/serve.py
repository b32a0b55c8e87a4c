"""`3ds serve`: the live page and the HTTP API."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from doorway3ds.camera.options import CameraOptions
from doorway3ds.cli.shared.listening import ListenOptions
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import quiet_decoders
from doorway3ds.cli.shared.robot import open_eyes
from doorway3ds.decide.options import DecideOptions
from doorway3ds.options import setting

if TYPE_CHECKING:
    from collections.abc import Callable

    from doorway3ds.sources import Source


@expand
def serve(
    camera: CameraOptions,
    decide: DecideOptions,
    listen: ListenOptions,
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="SOURCE",
            help="Source shown live on the page: a video, webcam://0, rtsp://... as in `3ds live`.",
        ),
    ] = None,
    loop: bool = setting(False, "Start a video or folder again at its end."),
    workers: int = setting(2, "Decisions made at once.", low=1, high=64),
    in_flight: int = setting(
        16, "Decisions running or waiting; further requests get 429.", low=1, high=10_000
    ),
    max_mb: float = setting(32, "Largest request body, in MiB.", low=0.01, high=1024),
    max_megapixels: float = setting(50, "Largest image, in megapixels.", low=0.01, high=1000),
) -> None:
    """Show decisions on a page and answer programs over HTTP, until Ctrl-C.

    Without SOURCE the page decides on images and on the browser's camera. Only this machine is
    answered unless --host says otherwise.

    Example: 3ds serve webcam://0 --camera pepper-top
    """
    from doorway3ds.camera.choice import choose_camera

    choice = choose_camera(camera)
    listening = listen.open()

    from doorway3ds.web.base.access import Limits
    from doorway3ds.web.serve.app import create_app
    from doorway3ds.web.serve.fields import Settings

    quiet_decoders()
    settings = Settings(
        token=listening.token,
        decide=decide,
        workers=workers,
        camera=choice,
        link=listening.shared,
        limits=Limits(
            max_bytes=int(max_mb * 2**20),
            max_pixels=int(max_megapixels * 1e6),
            in_flight=in_flight,
        ),
    )
    with listening.bound:
        listening.serve(create_app(settings, _source(source, camera, loop)), "serving")


def _source(
    uri: str | None, camera: CameraOptions, loop: bool
) -> tuple[str, Callable[[], Source]] | None:
    """The name of the page's source and how to open it; wrong ones are found here."""
    if uri is None:
        return None
    from doorway3ds.sources.address import without_password

    source = open_eyes(uri, camera, pace=True, loop=loop)
    return without_password(uri), lambda: source
