"""What the routes of `3ds serve` share."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from fastapi import Request

from doorway3ds.sources.base import Source
from doorway3ds.web.base.errors import ApiError
from doorway3ds.web.base.state import ServerState, server_state
from doorway3ds.web.serve.calibration import CalibrationRun
from doorway3ds.web.serve.fields import Pipelines, Settings
from doorway3ds.web.serve.live import Live


class ServeState(ServerState):
    """What the routes of the live page and the API share."""

    def __init__(
        self,
        settings: Settings,
        source: tuple[str, Callable[[], Source]] | None = None,
        pipelines: Pipelines | None = None,
    ) -> None:
        self.settings = settings
        self.pipelines = pipelines or Pipelines(settings)
        self.uploads = 0
        self.streams = 0
        self.live: Live | None = None
        self.calibration: CalibrationRun | None = None
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
        if self.calibration is not None:
            self.calibration.cancel()

    def close(self) -> None:
        if self.live is not None:
            self.live.stop()
        super().close()

    def require_live(self) -> Live:
        """The source; ApiError 404 without one."""
        if self.live is None:
            raise ApiError(
                404, "no_source", "this server has no source; start it as: 3ds serve SOURCE"
            )
        return self.live

    @property
    def source_state(self) -> str | None:
        return self.live.state if self.live else None


def serve_state(request: Request) -> ServeState:
    """What the server of a request shares between the routes of `3ds serve`."""
    return cast(ServeState, server_state(request))
