"""`3ds live`: decisions with memory on a camera, a stream, a video or a robot's eyes."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.cli._camera import CameraOptions, require_range
from doorway3ds.cli._film import Film, require_film
from doorway3ds.cli._options import (
    Camera,
    FovDeg,
    HeightM,
    MaxUnseenM,
    Method,
    Network,
    PitchDeg,
    RollDeg,
    Threads,
    WidthM,
)
from doorway3ds.cli._pipeline import build_pipeline
from doorway3ds.cli._signals import ended_by_sigterm

if TYPE_CHECKING:
    from doorway3ds.cli._camera import CameraChoice
    from doorway3ds.cli._panel import Panel
    from doorway3ds.pipeline import Pipeline
    from doorway3ds.runlog import RunLog
    from doorway3ds.sources import Source
    from doorway3ds.tracker import Tracked

_WAIT_S = 0.25
_SAY_S = 1.0  # between lines without a panel, where the reason stays the same


def live(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="webcam://0, rtsp://..., http://... (MJPEG), a video, a folder, 'pattern*.jpg', "
            "- (images on standard input), sim://... or nao://...",
        ),
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object per frame and line.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Annotated film: .mp4, .mkv, .avi, .webm.")
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Every picture and decision, for `3ds replay`."),
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
    pace: Annotated[
        bool | None,
        typer.Option(
            "--pace/--no-pace",
            help="Videos and folders in their own time, frames skipped as if live; default: only "
            "where a panel shows them and nothing is written.",
        ),
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Begin a file again at its end.")] = False,
    fps: Annotated[
        float | None, typer.Option(help="Of a folder's images and of standard input.")
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="End after so many.")] = None,
    patience_s: Annotated[
        float, typer.Option(help="End when a camera or stream stays away for so long.")
    ] = 60.0,
    threads: Threads = None,
) -> None:
    """Decide on every frame, with memory between frames, until the source ends or Ctrl-C.

    In a terminal a panel shows the decision; elsewhere a line is printed when it changes.
    Exit status: 0 the source ended, 1 it was lost or held pictures that could not be read,
    2 wrong call, 130 ended by Ctrl-C.
    """
    require_film(out)
    require_range("--fps", fps, 0.001, 1000)
    require_range("--patience-s", patience_s, 0, 1e6)
    choice = CameraOptions(camera, fov_deg, height_m, pitch_deg, roll_deg).resolve()
    pipeline = build_pipeline(method, network, width_m, max_unseen_m, threads)
    panelled = not as_json and sys.stdout.isatty()
    if pace is None:
        pace = panelled and out is None and record is None
    # libav writes warnings of its own for every hiccup of a stream.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    with ExitStack() as stack:
        stack.enter_context(ended_by_sigterm())
        given = {"pace": pace, "loop": loop, "fps": fps, "patience_s": patience_s}
        found = stack.enter_context(_open(source, choice, camera, fov_deg, given))
        run = _Run(pipeline, found, as_json)
        if out is not None:
            film = Film(out, found.fps)
            stack.callback(film.close)
            run.film = film
        if record is not None:
            run.log = stack.enter_context(_recording(record, pipeline, found))
        if panelled:
            from doorway3ds.cli._panel import Panel

            title = f"{found.name} · {method} · {pipeline.network.name}"
            run.panel = stack.enter_context(Panel(title, found))
        found.notice = run.panel.say if run.panel else _complain
        run.all(frames)
    if found.damaged and not found.live:
        raise typer.Exit(1)


class _Run:
    """What is done with each frame."""

    panel: Panel | None = None
    film: Film | None = None
    log: RunLog | None = None

    def __init__(self, pipeline: Pipeline, source: Source, as_json: bool) -> None:
        from doorway3ds.tracker import Tracker

        self._pipeline, self._source, self._as_json = pipeline, source, as_json
        self._tracker = Tracker()
        self._done = 0
        self._lost = False
        self._said: tuple[str, float] = ("", 0.0)

    def all(self, most: int | None) -> None:
        """Until the source ends, or `most` frames are answered."""
        from doorway3ds.types import Reason

        tracked = None
        while not self._source.ended and (most is None or self._done < most):
            frame = self._source.read(_WAIT_S)
            if frame is not None:
                self._lost = False
                tracked = self._tracker.update(self._pipeline.decide(frame))
                self._done += 1
                self._answer(tracked)
            elif self._source.live and not self._source.ended:
                silent = self._tracker.without_picture(time.monotonic())
                if silent is not None and silent.decision.reason is Reason.LOST:
                    self._miss(silent)
        if tracked is not None and self.panel is not None:
            self.panel.show(tracked, last=True)

    def _answer(self, tracked: Tracked) -> None:
        raw = tracked.raw
        if self._as_json:
            _print_json(self._line(tracked))
        elif self.panel is not None:
            self.panel.rate.tick()
            self.panel.means.add(dict(raw.timings_ms))
            self.panel.show(tracked)
        else:
            self._say(tracked)
        if self.film is not None:
            from doorway3ds.draw import overlay

            self.film.add(overlay(tracked.decision), raw.frame.stamp_s)
        if self.log is not None:
            self.log.look(self._done, raw, str(tracked.decision.reason))
            self.log.write("tracked", step=self._done, **tracked.to_dict())

    def _miss(self, silent: Tracked) -> None:
        """No picture comes any more: said once on paper, shown all the time in the panel."""
        if self.panel is not None:
            self.panel.show(silent)
        if self._lost:
            return
        self._lost = True
        if self._as_json:
            source = self._source
            tracked = {"problem": source.problem, "tracked": silent.to_dict()}
            lost = {"image": source.name, "reason": "lost", "turn_deg": None, **tracked}
            _print_json({**lost, "stamp_s": time.monotonic(), "source": _counts(source)})
        elif self.panel is None:
            self._say(silent)

    def _line(self, tracked: Tracked) -> dict[str, Any]:
        """The object of `3ds look --json`, and what memory adds."""
        return {
            **tracked.raw.to_dict(self._source.frame_name),
            "stamp_s": tracked.raw.frame.stamp_s,
            "tracked": tracked.to_dict(),
            "source": _counts(self._source),
        }

    def _say(self, tracked: Tracked) -> None:
        """A line where the reason changes, else once a second."""
        from doorway3ds.draw.words import headline, sentence

        decision, now = tracked.decision, time.monotonic()
        reason, said_s = self._said
        if reason == decision.reason and now - said_s < _SAY_S:
            return
        self._said = (str(decision.reason), now)
        words = f"{headline(decision)}. {sentence(decision)}".replace("\u00a0", " ")
        sys.stdout.write(f"{self._source.frame_name}: {words}\n")
        sys.stdout.flush()


def _open(
    uri: str,
    choice: CameraChoice,
    camera: str | None,
    fov_deg: float | None,
    options: dict[str, Any],
) -> Source:
    """The source; what the user says of the camera outranks what the source knows."""
    from doorway3ds.camera import Pose
    from doorway3ds.sources import open_source

    return open_source(
        uri,
        camera=choice.fit if camera is not None or fov_deg is not None else None,
        pose=None if choice.pose == Pose() else choice.pose,
        **options,
    )


@contextlib.contextmanager
def _recording(folder: Path, pipeline: Pipeline, source: Source) -> Iterator[RunLog]:
    """A log that also says how it ended."""
    from dataclasses import asdict

    from doorway3ds import __version__
    from doorway3ds.runlog import RunLog

    with RunLog(folder) as log:
        log.write(
            "start", version=__version__, method=pipeline.method, network=pipeline.network.name,
            gates=asdict(pipeline.gates), params=pipeline.params and asdict(pipeline.params),
            source=source.name, robot=None,
        )  # fmt: skip
        why = "the source ended"
        try:
            yield log
            why = why if source.ended else "as many frames as asked for"
        except BaseException as error:
            why = str(error) or type(error).__name__
            raise
        finally:
            log.write("end", outcome="ended", why=why, **_counts(source))


def _counts(source: Source) -> dict[str, int]:
    return {name: getattr(source, name) for name in ("skipped", "damaged", "reconnects")}


def _print_json(line: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(line, allow_nan=False) + "\n")
    sys.stdout.flush()


def _complain(message: str) -> None:
    sys.stderr.write(f"3ds: {message}\n")
    sys.stderr.flush()
