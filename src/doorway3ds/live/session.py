"""The one engine: a source, a pipeline and memory between frames at work together."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from doorway3ds.arguments import require
from doorway3ds.camera.model import Camera, Pose, wrapped_deg
from doorway3ds.closing import Closing
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.draw.words import counted
from doorway3ds.live.eyes import Eyes, Update
from doorway3ds.live.feed import Feed
from doorway3ds.live.lens import LensWatch
from doorway3ds.live.track import TrackerParams
from doorway3ds.live.tracker import Tracker
from doorway3ds.sources import Source, open_source
from doorway3ds.types import Frame, Perception, Reason

if TYPE_CHECKING:
    from doorway3ds.sources.base import CameraFor, PoseOf

_WAIT_S = 0.25


@dataclass(frozen=True)
class _Setup:
    """By what is decided, as one value: another thread may put a new one in its place."""

    pipeline: Pipeline
    tracker: Tracker
    adapt: Callable[[Frame], Frame]


@dataclass(frozen=True)
class _Seen:
    """A frame, what it is called, what the network saw in it, and by what to decide."""

    frame: Frame
    name: str
    perception: Perception
    setup: _Setup


class Session(Closing, Eyes):
    """Decides on every frame of a source, with memory; an iterator of `Update`.

    The network looks at the next frame in a thread of its own while one is decided on and used.
    Use it as a context manager, so that its threads end.

    source: stays the caller's, to be closed after the session, unless `owns`.
    ahead: threads, as of a `Feed`; default: 2, of a live source 1; with 0 it looks when asked.
    heading: the robot's, in degrees, + left, if one turns under the camera; None: unknown now.
    clock: of the frames' stamps.
    lens: compare a few frames with the camera's focal length, in a thread of its own; the source's
        `notice` is called once if they contradict it.
    """

    def __init__(
        self,
        source: Source,
        pipeline: Pipeline,
        *,
        ahead: int | None = None,
        heading: Callable[[], float | None] = lambda: None,
        owns: bool = False,
        clock: Callable[[], float] = time.monotonic,
        lens: bool = True,
    ) -> None:
        super().__init__(clock)
        self.source = source
        self._lens = LensWatch(lambda line: source.notice(line)) if lens else None
        self._setup = _Setup(pipeline, _tracker(pipeline), _as_it_is)
        self._heading = heading
        self._headed_deg: float | None = None
        self._owns = owns
        self._stopping = threading.Event()
        self._last: Update | None = None
        self._memory = self._setup.tracker  # of the last frame decided on
        usual = 1 if source.live else 2
        self._feed = Feed(source, self._see, ahead=usual if ahead is None else ahead)

    @property
    def pipeline(self) -> Pipeline:
        return self._setup.pipeline

    def __repr__(self) -> str:
        number = 0 if self._last is None else self._last.number
        return f"<Session of {self.source.name}, {counted(number, 'update')}>"

    @property
    def doubt(self) -> str | None:
        """Why the camera's focal length is in doubt, in one line, or None."""
        return None if self._lens is None else self._lens.doubt

    @property
    def ended(self) -> bool:
        """Nothing further will come: the source ended, or `stop` was called."""
        return self._feed.ended or self._stopping.is_set()

    @property
    def silent(self) -> bool:
        """The source was asked and gave no frame for a while."""
        return self._feed.silent and not self._feed.ended

    def use(self, pipeline: Pipeline, adapt: Callable[[Frame], Frame] | None = None) -> None:
        """Decides by another pipeline, without memory, from the next frame on; from any thread.

        adapt: changes each frame before it is looked at, such as its camera.
        """
        self._setup = _Setup(pipeline, _tracker(pipeline), adapt or _as_it_is)

    def read(self, timeout_s: float | None = None) -> Update | None:
        """The next update; None if there is none within `timeout_s` seconds, or when `ended`.

        While a live source is silent for too long, each call returns an update that is not fresh.
        Raises what the source or the network raised: SourceLost if the source is gone; after
        another UserError further frames may come.
        """
        seen = self._feed.read(timeout_s)
        if seen is not None:
            decision = seen.setup.pipeline.conclude(seen.frame, seen.perception)
            self._memory = seen.setup.tracker
            tracked = self._memory.update(decision, self._turned_deg())
            number = 1 if self._last is None else self._last.number + 1
            self._last = Update(number, seen.name, tracked)
            if self._lens is not None:
                self._lens.offer(seen.frame)
            return self._last
        if self.source.live and self.silent:
            return self._without_picture(self._clock())
        return None

    def lost(self) -> Update | None:
        """What is known if no further frame comes, though it should; None before the first."""
        return self._without_picture(float("inf"))

    def stop(self) -> None:
        """Ends the iteration, from any thread."""
        self._stopping.set()

    def close(self) -> None:
        """Ends the threads, and closes the source if it is the session's own."""
        self.stop()
        self._feed.close()
        if self._lens is not None:
            self._lens.close()
        if self._owns:
            self.source.close()

    def __iter__(self) -> Iterator[Update]:
        was_lost = False
        while not self.ended:
            update = self.read(_WAIT_S)
            if update is not None and (update.fresh or not was_lost):
                was_lost = not update.fresh
                yield update

    def _see(self, frame: Frame, name: str) -> _Seen | None:
        """The network's part, in the feed's thread."""
        if frame.stamp_s < self._from_s:
            return None
        setup = self._setup
        frame = setup.adapt(frame)
        return _Seen(frame, name, setup.pipeline.perceive(frame), setup)

    def _without_picture(self, now_s: float) -> Update | None:
        silent = self._memory.without_picture(now_s)
        if silent is None or self._last is None or silent.decision.reason is not Reason.LOST:
            return None
        problem = self.source.problem or "no image arrives"
        return Update(self._last.number, self.source.name, silent, fresh=False, problem=problem)

    def _turned_deg(self) -> float:
        """By how much the robot has turned since the frame before."""
        before, self._headed_deg = self._headed_deg, self._heading()
        if before is None or self._headed_deg is None:
            return 0.0
        return wrapped_deg(self._headed_deg - before)


def watch(
    source: Source | str | os.PathLike[str],
    pipeline: Pipeline | None = None,
    *,
    camera: Camera | CameraFor | None = None,
    pose: Pose | PoseOf | None = None,
    **options: Any,
) -> Session:
    """Decides on every frame of a source, with memory between frames.

    >>> with watch("examples/*door*.jpg", fps=2) as updates:
    ...     [update.number for update in updates]
    [1, 2]

    Args:
        source: an open source, which stays the caller's, or the URI of one (`open_source`).
        pipeline: what decides; default: the packaged network and the `opening` method.
        camera: as `open_source` takes it, for a URI.
        pose: likewise.
        options: likewise.

    Returns:
        A session: a context manager and an iterator of updates.

    Raises:
        UserError: for a URI that names no source, an argument of another kind, or if it cannot be
            opened.
    """
    require("pipeline", pipeline, (Pipeline, type(None)), "a Pipeline or None")
    pipeline = pipeline or Pipeline.default()
    if isinstance(source, Source):
        return Session(source, pipeline)
    return Session(
        open_source(source, camera=camera, pose=pose, **options),
        pipeline,
        ahead=1 if options.get("pace") else None,
        owns=True,
    )


def _tracker(pipeline: Pipeline) -> Tracker:
    """Memory that faces a doorway within what the pipeline's gates call aligned."""
    usual, limit = TrackerParams(), pipeline.gates.aligned_deg
    wider = usual.turn_from_deg / usual.aligned_deg * limit
    return Tracker(TrackerParams(aligned_deg=limit, turn_from_deg=wider))


def _as_it_is(frame: Frame) -> Frame:
    return frame
