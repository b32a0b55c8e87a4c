"""The application of `3ds label`: the server's shield and files round the routes of marking."""

from __future__ import annotations

from doorway3ds.images.codec import MAX_PIXELS
from doorway3ds.web.base.access import Limits, ServerSettings
from doorway3ds.web.base.app import assemble
from doorway3ds.web.base.shield import Shield
from doorway3ds.web.label import routes
from doorway3ds.web.label.pictures import Pictures
from doorway3ds.web.label.routes import LabelState
from doorway3ds.web.label.table import Table


def label_settings(token: str | None, link: str | None) -> ServerSettings:
    """Bodies are small here, images come from the disk, and one thread looks at them."""
    limits = Limits(max_bytes=64 * 1024, max_pixels=MAX_PIXELS, in_flight=32, decision_s=60.0)
    return ServerSettings(token=token, workers=1, link=link, limits=limits)


def create_label_app(settings: ServerSettings, pictures: Pictures, table: Table) -> Shield:
    """The whole application, for any ASGI server."""
    return assemble(
        LabelState(settings, pictures, table),
        routes.router,
        title="doorway3ds label",
        summary="Images of a folder, marked by hand.",
    )
