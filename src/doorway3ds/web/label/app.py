"""The application of `3ds label`: the server's shield and files round the routes of marking."""

from __future__ import annotations

from typing import cast

from fastapi import Request

from doorway3ds.images.codec import MAX_PIXELS
from doorway3ds.web.base.app import assemble
from doorway3ds.web.base.settings import Limits, ServerSettings
from doorway3ds.web.base.shield import Shield
from doorway3ds.web.base.state import ServerState, server_state
from doorway3ds.web.label.pictures import Pictures
from doorway3ds.web.label.table import Table


class LabelState(ServerState):
    """What the routes of marking share."""

    def __init__(self, settings: ServerSettings, pictures: Pictures, table: Table) -> None:
        super().__init__(settings, "label.html")
        self.pictures = pictures
        self.table = table


def label_state(request: Request) -> LabelState:
    """What the server of a request shares between its routes."""
    return cast(LabelState, server_state(request))


def label_settings(token: str | None, link: str | None) -> ServerSettings:
    """Bodies are small here, pictures come from the disk, and one thread looks at them."""
    limits = Limits(max_bytes=64 * 1024, max_pixels=MAX_PIXELS, in_flight=32, decision_s=60.0)
    return ServerSettings(token=token, workers=1, link=link, limits=limits)


def create_label_app(settings: ServerSettings, pictures: Pictures, table: Table) -> Shield:
    """The whole application, for any ASGI server."""
    from doorway3ds.web.label import routes

    return assemble(
        LabelState(settings, pictures, table),
        routes.router,
        title="doorway3ds label",
        summary="Pictures of a folder, marked by hand.",
    )
