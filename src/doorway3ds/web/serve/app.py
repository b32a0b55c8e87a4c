"""The application of `3ds serve`."""

from __future__ import annotations

from collections.abc import Callable

from doorway3ds.sources.base import Source
from doorway3ds.web.base.app import assemble
from doorway3ds.web.base.shield import Shield
from doorway3ds.web.serve import calibration_routes, routes
from doorway3ds.web.serve.fields import Pipelines, Settings
from doorway3ds.web.serve.state import ServeState


def create_app(
    settings: Settings,
    source: tuple[str, Callable[[], Source]] | None = None,
    pipelines: Pipelines | None = None,
) -> Shield:
    """The whole application, for any ASGI server.

    source: the name of the server's own source and how to open it. pipelines: default: those that
    `settings` names, opened here, so that a missing network is an error before anybody asks.

    Raises UserError if the network cannot be opened.
    """
    return assemble(
        ServeState(settings, source, pipelines),
        routes.router,
        calibration_routes.router,
        title="doorway3ds",
        summary="Open doorways, their direction and the way to them, from one image.",
    )
