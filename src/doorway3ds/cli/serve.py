"""`3ds serve`: the live page and the HTTP API."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from doorway3ds.camera.options import CameraOptions
from doorway3ds.cli.shared.listening import (
    Host,
    ListenOptions,
    Port,
    TlsCert,
    TlsKey,
    TlsName,
    Token,
)
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.robot import open_eyes
from doorway3ds.decide.options import DecideOptions
from doorway3ds.options import require_range

if TYPE_CHECKING:
    from collections.abc import Callable

    from doorway3ds.sources import Source


@expand
def serve(
    camera: CameraOptions,
    decide: DecideOptions,
    source: Annotated[
        str | None,
        typer.Argument(
            help="Source shown live on the page: a video, webcam://0, rtsp://... as in `3ds live`."
        ),
    ] = None,
    host: Host = "127.0.0.1",
    port: Port = 8000,
    token: Token = None,
    tls: Annotated[
        bool,
        typer.Option("--tls", help="Serve over HTTPS, which phones require to share their camera."),
    ] = False,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    tls_name: TlsName = None,
    loop: Annotated[
        bool, typer.Option("--loop", help="Start a video or folder again at its end.")
    ] = False,
    workers: Annotated[int, typer.Option(min=1, max=64, help="Decisions made at once.")] = 2,
    in_flight: Annotated[
        int,
        typer.Option(
            min=1, max=10_000, help="Decisions running or waiting; further requests get 429."
        ),
    ] = 16,
    max_mb: Annotated[float, typer.Option(help="Largest request body, in MiB.")] = 32,
    max_megapixels: Annotated[float, typer.Option(help="Largest image, in megapixels.")] = 50,
) -> None:
    """Show decisions on a page and answer programs over HTTP, until Ctrl-C.

    Without SOURCE the page decides on images and on the browser's camera. Only this machine is
    answered unless --host says otherwise.

    Example: 3ds serve webcam://0 --camera pepper-top
    """
    require_range("--max-mb", max_mb, 0.01, 1024)
    require_range("--max-megapixels", max_megapixels, 0.01, 1000)
    from doorway3ds.camera.choice import choose_camera

    choice = choose_camera(camera)
    listening = ListenOptions(
        host, port, token, tls, tls_cert, tls_key, tuple(tls_name or ())
    ).open()

    import cv2

    from doorway3ds.web.base.settings import Limits
    from doorway3ds.web.serve.app import create_app
    from doorway3ds.web.serve.settings import Settings

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
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
