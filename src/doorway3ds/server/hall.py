"""What the routes of one server share."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import cast

from fastapi import Request

from doorway3ds.server import metrics as counting
from doorway3ds.server.choice import Pipelines
from doorway3ds.server.live import Live
from doorway3ds.server.pages import Pages
from doorway3ds.server.settings import Settings
from doorway3ds.server.work import Work
from doorway3ds.sources.base import Source


class Hall:
    """All that a server holds while it runs.

    closing: set when the server is to end, so that streams do.
    """

    def __init__(
        self,
        settings: Settings,
        source: tuple[str, Callable[[], Source]] | None = None,
        pipelines: Pipelines | None = None,
    ) -> None:
        limits = settings.limits
        self.settings = settings
        self.pipelines = pipelines or Pipelines(settings)
        self.work = Work(limits.in_flight, settings.workers, limits.decision_s)
        self.pages = Pages()
        self.uploads = 0
        self.streams = 0
        self.closing = asyncio.Event()
        self.metrics = counting.standard(
            {
                "doorway3ds_in_flight": (
                    "Decisions that run or wait.",
                    lambda: self.work.in_flight,
                ),
                "doorway3ds_uploads": ("Bodies being read.", lambda: self.uploads),
                "doorway3ds_streams": ("Clients of the event stream.", lambda: self.streams),
                "doorway3ds_source_frames": (
                    "Frames of the source decided on.",
                    lambda: self.live.frames if self.live else 0,
                ),
                "doorway3ds_source_skipped": (
                    "Frames of the source passed over for newer ones.",
                    lambda: self.live.skipped if self.live else 0,
                ),
            }
        )
        self.live = (
            Live(source[0], source[1], self.pipelines, settings, self.metrics) if source else None
        )

    def end(self) -> None:
        """Ends what would otherwise go on for ever, so that the server can stop."""
        self.closing.set()
        if self.live is not None:
            self.live.release()


def hall_of(request: Request) -> Hall:
    """What the server of a request shares between its routes."""
    return cast(Hall, request.app.state.hall)
