"""The server's own source: a thread that decides on the newest frame, and who waits for it."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from doorway3ds.draw import annotate, overlay
from doorway3ds.errors import UserError
from doorway3ds.images.codec import encode_jpeg
from doorway3ds.live.eyes import Update
from doorway3ds.live.session import Session
from doorway3ds.live.tracker import Tracked
from doorway3ds.sources.base import Source, SourceLost
from doorway3ds.threads import Worker
from doorway3ds.types import Decision, Reason
from doorway3ds.web.base.metrics import Metrics
from doorway3ds.web.base.routes import SourceState
from doorway3ds.web.serve.fields import Fields, Pipelines, Settings, source_frame
from doorway3ds.web.serve.view import view_of

Style = Literal["overlay", "plain", "page"]
_KEPT = 6  # frames whose images a client that reads events may still ask for
_RATE_S = 2.0  # over which frames a second are averaged
_WAIT_S = 0.5  # for a frame, before the state says that none comes

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Snapshot:
    """One decision of the source, alone and with memory; images of it are made on demand."""

    number: int
    decision: Decision
    tracked: Tracked
    frames_per_s: float
    _made: dict[str, Any] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def to_dict(self, view: bool = False) -> dict[str, Any]:
        """The decision's JSON with `frame`, `frames_per_s` and what the tracker makes of it."""
        answer = self.decision.to_dict()
        answer["frame"] = self.number
        answer["stamp_s"] = self.decision.frame.stamp_s
        answer["frames_per_s"] = round(self.frames_per_s, 2)
        answer["tracked"] = self.tracked.to_dict()
        if view:
            answer["view"] = self._once("view", lambda: view_of(self.tracked.decision))
        return answer

    def jpeg(self, style: Style) -> bytes:
        """The image with its marks, as it came, or the whole annotated page."""
        draw: dict[Style, Callable[[], NDArray[np.uint8]]] = {
            "overlay": lambda: overlay(self.tracked.decision),
            "plain": lambda: self.decision.frame.image,
            "page": lambda: annotate(self.tracked.decision),
        }
        picture: bytes = self._once(style, lambda: encode_jpeg(draw[style]()))
        return picture

    def _once(self, key: str, make: Callable[[], Any]) -> Any:
        with self._lock:
            if key not in self._made:
                self._made[key] = make()
            return self._made[key]


class Live:
    """Reads a source in threads of its own for as long as the server runs.

    name: the source as the user may see it. state: what it does now; `problem` says why in words.
    """

    def __init__(
        self,
        name: str,
        start: Callable[[], Source],
        pipelines: Pipelines,
        settings: Settings,
        metrics: Metrics,
    ) -> None:
        self.name = name
        self.state: SourceState = "starting"
        self.problem: str | None = None
        self.fields = Fields()
        self._start = start
        self._pipelines = pipelines
        self._settings = settings
        self._metrics = metrics
        self._pipeline = pipelines.get(self.fields)
        self._session: Session | None = None
        self._ring: OrderedDict[int, Snapshot] = OrderedDict()
        self._count = 0
        self._rate = 0.0
        self._stopping = threading.Event()
        self._released = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._changed: asyncio.Event | None = None
        self._worker: Worker | None = None

    def start(self) -> None:
        """Begins to read; call it in the event loop that will wait for frames."""
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        self._worker = Worker(self._run, "live", self._halt)

    def release(self) -> None:
        """Lets nobody wait any longer."""
        self._released = True
        self._wake()

    def stop(self) -> None:
        """Ends the thread and wakes everybody who waits."""
        if self._worker is not None:
            self._worker.close(5)
        self._enter("stopped", None)

    def _halt(self) -> None:
        self._stopping.set()
        if self._session is not None:
            self._session.source.close()

    def use(self, fields: Fields) -> None:
        """Decides by other settings from the next frame on.

        Raises ApiError or UserError if they cannot be used; the old ones then stay.
        """
        pipeline = self._pipelines.get(fields)
        self._pipeline, self.fields = pipeline, fields
        if self._session is not None:
            self._adopt(self._session)

    def _adopt(self, session: Session) -> None:
        adapt = partial(source_frame, fields=self.fields, usual=self._settings.camera)
        session.use(self._pipeline, adapt)

    @property
    def doubt(self) -> str | None:
        """Why the camera's focal length is in doubt, in one line, or None."""
        return None if self._session is None else self._session.doubt

    @property
    def source(self) -> Source | None:
        """The source, once it is open."""
        return None if self._session is None else self._session.source

    @property
    def skipped(self) -> int:
        return 0 if self._session is None else self._session.source.skipped

    @property
    def frames(self) -> int:
        return self._count

    @property
    def newest(self) -> Snapshot | None:
        return self.get(self._count)

    def get(self, number: int) -> Snapshot | None:
        """The snapshot of that number, if it is still kept."""
        return self._ring.get(number)

    async def change(self, seen: tuple[int, str], timeout_s: float) -> bool:
        """Waits until number of frames or state are others than `seen`; False after `timeout_s`."""
        if self._changed is None:
            raise RuntimeError("the source was not started")
        end = time.monotonic() + timeout_s
        while (self._count, self.state) == seen and not self._released:
            left = end - time.monotonic()
            if left <= 0:
                return False
            try:
                await asyncio.wait_for(self._changed.wait(), left)
            except TimeoutError:
                return False
        return True

    def _run(self) -> None:
        try:
            with ExitStack() as stack:
                source = stack.enter_context(self._start())
                source.notice = log.warning  # before the session, which reads ahead at once
                session = stack.enter_context(Session(source, self._pipeline, ahead=1))
                self._session = session
                if self.fields != Fields():  # changed meanwhile
                    self._adopt(session)
                last = time.monotonic()
                while not session.ended and not self._stopping.is_set():
                    try:
                        update = session.read(_WAIT_S)
                        if update is not None and update.fresh:
                            now = time.monotonic()
                            self._measure(now - last)
                            last = now
                            self._metrics.decided(
                                "source", str(update.raw.reason), update.raw.timings_ms
                            )
                            self._keep(update, self._rate)
                            self._enter("running", None)
                        elif session.silent:
                            self._miss(update, source.problem)
                    except SourceLost:
                        raise
                    except UserError as error:  # of this image alone
                        self._enter("waiting", str(error))
                self._enter("ended", f"{self.name} has ended")
        except UserError as error:
            self._lose(str(error))
        except Exception:
            # The page must say so: a thread that dies in silence looks like a door that stands.
            log.exception("the source's thread failed")
            self._lose("the server failed on an image; see its log")

    def _measure(self, gap_s: float) -> None:
        weight = min(1.0, gap_s / _RATE_S)
        self._rate += weight * (1.0 / max(gap_s, 1e-3) - self._rate)

    def _miss(self, silent: Update | None, problem: str | None) -> None:
        """No image came in time: what was seen last must not stand for long."""
        newest = self.newest
        if silent is not None and newest and newest.decision.reason is not Reason.LOST:
            self._keep(silent, 0.0)
        self._enter("waiting", problem or "no image arrives")

    def _lose(self, problem: str) -> None:
        """No further image will come, though it should."""
        lost = None if self._session is None else self._session.lost()
        if lost is not None:
            self._keep(lost, 0.0)
        self._enter("lost", problem)

    def _keep(self, update: Update, rate: float) -> None:
        tracked = update.tracked
        decision = update.raw if update.fresh else update.decision
        snapshot = Snapshot(self._count + 1, decision, tracked, rate)
        self._ring[snapshot.number] = snapshot
        self._count = snapshot.number
        self._ring.pop(snapshot.number - _KEPT, None)

    def _enter(self, state: SourceState, problem: str | None) -> None:
        self.state, self.problem = state, problem
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        if self._changed is not None:
            self._changed.set()
            self._changed.clear()
