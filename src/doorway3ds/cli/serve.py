"""`3ds serve`: the live page and the HTTP API."""

from __future__ import annotations

import os
import re
import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from doorway3ds.cli._camera import CameraOptions, require_range
from doorway3ds.cli._options import (
    Camera,
    FovDeg,
    HeightM,
    MaxUnseenM,
    Method,
    Network,
    PitchDeg,
    RollDeg,
    WidthM,
)
from doorway3ds.errors import CallError

if TYPE_CHECKING:
    from collections.abc import Callable

    from doorway3ds.cli._camera import CameraChoice
    from doorway3ds.server.settings import Settings
    from doorway3ds.server.tls import Certificate
    from doorway3ds.sources import Source

TOKEN_VARIABLE = "DOORWAY3DS_TOKEN"
_TOKEN = re.compile(r"[A-Za-z0-9._~-]{8,256}")


def serve(
    source: Annotated[
        str | None,
        typer.Argument(help="Shown live on the page: a video, webcam://0, rtsp://... as in `live`"),
    ] = None,
    host: Annotated[str, typer.Option(help="0.0.0.0 for other devices.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 8000,
    token: Annotated[
        str | None,
        typer.Option(
            envvar=TOKEN_VARIABLE,
            help="What clients must know, or `new`; needed with --host other than this machine.",
        ),
    ] = None,
    tls: Annotated[
        bool, typer.Option("--tls", help="HTTPS, which phones need to lend their camera.")
    ] = False,
    tls_cert: Annotated[
        Path | None, typer.Option(metavar="FILE", help="PEM; default: one made on the spot.")
    ] = None,
    tls_key: Annotated[Path | None, typer.Option(metavar="FILE", help="PEM.")] = None,
    tls_name: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="More names for the one made here.")
    ] = None,
    method: Method = "opening",
    network: Network = "doornet",
    camera: Camera = None,
    fov_deg: FovDeg = None,
    height_m: HeightM = None,
    pitch_deg: PitchDeg = None,
    roll_deg: RollDeg = None,
    width_m: WidthM = None,
    max_unseen_m: MaxUnseenM = None,
    loop: Annotated[
        bool, typer.Option("--loop", help="Begin a video or folder again at its end.")
    ] = False,
    threads: Annotated[int | None, typer.Option(min=1, help="For each network.")] = None,
    workers: Annotated[int, typer.Option(min=1, max=64, help="Decisions at once.")] = 2,
    in_flight: Annotated[
        int, typer.Option(min=1, max=10_000, help="Decisions that run or wait; more get 429.")
    ] = 16,
    max_mb: Annotated[float, typer.Option(help="Largest body of a request, MiB.")] = 32,
    max_megapixels: Annotated[float, typer.Option(help="Largest picture.")] = 50,
) -> None:
    """Show decisions on a page and answer programs over HTTP, until Ctrl-C.

    SOURCE is what the page shows live; without one it decides on pictures and on the camera of
    the browser. Only this machine is answered unless --host says otherwise.
    """
    if method not in ("opening", "paper"):
        raise CallError(f"--method must be opening or paper, got {method!r}")
    require_range("--width-m", width_m, 0.01, 5)
    require_range("--max-unseen-m", max_unseen_m, 0, 100)
    require_range("--max-mb", max_mb, 0.01, 1024)
    require_range("--max-megapixels", max_megapixels, 0.01, 1000)
    options = CameraOptions(camera, fov_deg, height_m, pitch_deg, roll_deg)
    choice = options.resolve()
    tls = tls or tls_cert is not None or tls_key is not None

    from doorway3ds.server.settings import Limits, Settings, is_loopback

    token = _token(token, host, is_loopback(host))

    import cv2

    from doorway3ds.server.app import create_app
    from doorway3ds.server.links import link, qr_text
    from doorway3ds.server.run import listen, make_server

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    certificate = _certificate(tls_cert, tls_key, tuple(tls_name or ())) if tls else None
    bound = listen(host, port)
    port = bound.getsockname()[1]
    shared = None if is_loopback(host) else link(host, port, tls, token)
    settings = Settings(
        token=token,
        method=method,
        network=network,
        threads=threads,
        workers=workers,
        camera=choice.fit if camera is not None or fov_deg is not None else None,
        pose=choice.pose,
        width_m=width_m,
        max_unseen_m=max_unseen_m,
        link=shared,
        limits=Limits(
            max_bytes=int(max_mb * 2**20),
            max_pixels=int(max_megapixels * 1e6),
            in_flight=in_flight,
        ),
    )
    with bound:
        app = create_app(settings, _source(source, choice, loop, settings))

        def ready() -> None:
            here = link("127.0.0.1" if host in ("0.0.0.0", "") else host, port, tls, token)
            typer.echo(f"serving {shared or here}")
            if shared is not None:
                _say(qr_text(shared))
            if certificate is not None and tls_cert is None:
                _say(
                    "the certificate was made by this machine: browsers warn once; "
                    f"its SHA-256 fingerprint is\n{certificate.fingerprint}"
                )
            sys.stdout.flush()

        make_server(app, certificate, ready).run(sockets=[bound])


def _say(text: str) -> None:
    typer.echo(text, err=True)


def _token(token: str | None, host: str, is_loopback: bool) -> str | None:
    if token == "new":
        return secrets.token_urlsafe(24)
    if token is not None and not _TOKEN.fullmatch(token):
        raise CallError(
            "--token must be `new` or 8 to 256 letters, digits and . _ ~ - as in a link"
        )
    if token is None and not is_loopback:
        raise CallError(
            f"--host {host} lets other machines in; add --token new, or --token TEXT, or set "
            f"{TOKEN_VARIABLE}"
        )
    return token


def _certificate(chain: Path | None, key: Path | None, names: tuple[str, ...]) -> Certificate:
    from doorway3ds.server import tls

    if (chain is None) != (key is None):
        raise CallError("--tls-cert and --tls-key go together; give both or neither")
    if chain is not None and key is not None:
        return tls.given(chain, key)
    return tls.self_signed(_private_folder(), names)


def _private_folder() -> Path:
    """Where the certificate and key made here lie, for this user alone."""
    base = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(base) / "doorway3ds" / "tls"


def _source(
    uri: str | None,
    choice: CameraChoice,
    loop: bool,
    settings: Settings,
) -> tuple[str, Callable[[], Source]] | None:
    """The name of the page's source and how to open it; wrong ones are found here."""
    if uri is None:
        return None
    from doorway3ds.camera import Pose
    from doorway3ds.sources import open_source
    from doorway3ds.sources.uri import without_password

    source = open_source(
        uri,
        camera=settings.camera,
        pose=None if choice.pose == Pose() else choice.pose,
        pace=True,
        loop=loop,
    )
    return without_password(uri), lambda: source
