"""What the routes of `3ds label` share."""

from __future__ import annotations

from typing import cast

from fastapi import Request

from doorway3ds.web.base.access import ServerSettings
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
