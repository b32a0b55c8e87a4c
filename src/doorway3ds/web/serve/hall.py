"""What the routes of one server share: every server's entrance, and the hall of `3ds serve`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import cast

from fastapi import Request

from doorway3ds.sources.base import Source
from doorway3ds.web.base import metrics as counting
from doorway3ds.web.base.pages import Pages
from doorway3ds.web.serve.choice import Pipelines
from doorway3ds.web.serve.live import Live
from doorway3ds.web.serve.settings import Settings
from doorway3ds.web.serve.work import Work


class Entrance:
    """What every server holds while it runs, whatever its routes are for.

    home: the file of `server/static` that `/` shows. gauges: further numbers for /metrics, name ->
    (help, value). closing: set when the server is to end, so that streams do.
    """

    def __init__(
        self,
        settings: Settings,
        home: str,
        gauges: Mapping[str, tuple[str, Callable[[], float]]] | None = None,
    ) -> None:
        limits = settings.limits
        self.settings = settings
        self.home = home
        self.work = Work(limits.in_flight, settings.workers, limits.decision_s)
        self.pages = Pages()
        self.closing = asyncio.Event()
        at_hand = ("Decisions that run or wait.", lambda: self.work.in_flight)
        self.metrics = counting.standard({"doorway3ds_in_flight": at_hand, **(gauges or {})})

    def begin(self) -> None:
        """Starts what goes on by itself; called in the event loop."""

    def end(self) -> None:
        """Ends what would otherwise go on for ever, so that the server can stop."""
        self.closing.set()

    def close(self) -> None:
        """Returns once nothing goes on any more."""
        self.work.close()

    @property
    def state(self) -> str | None:
        """What the server's source does; None where it has none."""
        return None


class Hall(Entrance):
    """What the routes of the live page and the API share."""

    def __init__(
        self,
        settings: Settings,
        source: tuple[str, Callable[[], Source]] | None = None,
        pipelines: Pipelines | None = None,
    ) -> None:
        self.pipelines = pipelines or Pipelines(settings)
        self.uploads = 0
        self.streams = 0
        self.live: Live | None = None
        super().__init__(
            settings,
            "index.html",
            {
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
            },
        )
        if source is not None:
            self.live = Live(source[0], source[1], self.pipelines, settings, self.metrics)

    def begin(self) -> None:
        if self.live is not None:
            self.live.start()

    def end(self) -> None:
        super().end()
        if self.live is not None:
            self.live.release()

    def close(self) -> None:
        if self.live is not None:
            self.live.stop()
        super().close()

    @property
    def state(self) -> str | None:
        return self.live.state if self.live else None


def entrance_of(request: Request) -> Entrance:
    """What the server of a request shares between its routes, whatever they are for."""
    return cast(Entrance, request.app.state.entrance)


def hall_of(request: Request) -> Hall:
    """The same for the routes of `3ds serve`."""
    return cast(Hall, request.app.state.entrance)
