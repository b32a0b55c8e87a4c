"""The server's own source: events, pictures, other settings, and what happens when it is gone."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.images.codec import read_image
from doorway3ds.sources.base import Source, SourceLost, View
from doorway3ds.types import Frame
from tests.factories import scene
from tests.web.conftest import Serve, Served, wait_for

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


class Tap(Source):
    """Gives a frame whenever the test says so; where it is `live`, silence loses the doorway."""

    def __init__(self, live: bool = False) -> None:
        super().__init__("tap")
        self.live = live
        self.wanted = threading.Semaphore(0)
        self.lost = False
        self.closed = False

    def read(self, timeout_s: float | None = None) -> Frame | None:
        if not self.wanted.acquire(timeout=0.05):
            return None
        if self.lost:
            raise SourceLost("the tap is dry")
        return self.frame()

    def frame(self) -> Frame:
        return View().frame(scene(160, 120), time.monotonic())

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def tap() -> Tap:
    return Tap()


@pytest.fixture
def served(serve: Serve, tap: Tap) -> Served:
    return serve(source=("tap", lambda: tap))


def events(answer: httpx.Response) -> Iterator[tuple[str, dict[str, object]]]:
    kind = ""
    for line in answer.iter_lines():
        if line.startswith("event: "):
            kind = line.removeprefix("event: ")
        elif line.startswith("data: "):
            yield kind, json.loads(line.removeprefix("data: "))


def test_decisions_come_as_events_with_memory(served: Served, tap: Tap) -> None:
    with served.client.stream("GET", "/v1/stream?view=true") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        heard = events(answer)
        assert next(heard)[0] == "source"
        numbers = []
        while len(numbers) < 3:
            tap.wanted.release()
            kind, data = next(heard)
            if kind == "decision":
                numbers.append(data["frame"])
                assert data["reason"] == "turn"
                assert 0.5 < data["tracked"]["belief"] < 1
                assert data["view"]["width"] == 160
        assert numbers == sorted(set(numbers))
        assert served.state.streams == 1
    wait_for(lambda: served.state.streams == 0)


def test_the_pictures_are_those_of_the_events(served: Served, tap: Tap) -> None:
    assert served.client.get("/v1/frame.jpg").status_code == 503
    tap.wanted.release()
    wait_for(lambda: served.state.live.frames == 1)
    plain = served.client.get("/v1/frame.jpg?style=plain&frame=1")
    assert plain.headers["x-frame"] == "1"
    shown = read_image(plain.content).image
    assert np.abs(shown.astype(int) - scene(160, 120)).mean() < 8
    marked = read_image(served.client.get("/v1/frame.jpg").content).image
    assert np.abs(marked.astype(int) - shown).mean() > 8
    page = read_image(served.client.get("/v1/frame.jpg?style=page").content).image
    assert page.shape[1] == 1600
    gone = served.client.get("/v1/frame.jpg?frame=7")
    assert (gone.status_code, gone.json()["error"]["code"]) == (404, "frame_gone")
    newest = served.client.get("/v1/decision").json()
    assert (newest["image"], newest["frame"]) == ("tap", 1)


def test_other_settings_hold_from_the_next_frame_on(served: Served, tap: Tap) -> None:
    changed = served.client.put("/v1/source", json={"method": "paper", "fov_deg": 40})
    assert changed.json()["fields"] == {"method": "paper", "fov_deg": 40}
    tap.wanted.release()
    wait_for(lambda: served.state.live.frames == 1)
    answer = served.client.get("/v1/decision").json()
    assert answer["method"] == "paper"
    assert answer["camera"]["name"] == "fov 40 deg"
    for fields in ({"network": "nothing.onnx"}, {"fov_deg": "40"}, {"height_m": True}):
        assert served.client.put("/v1/source", json=fields).status_code == 422
    head = {"Content-Type": "application/json"}
    damaged = served.client.put("/v1/source", content=b'{"method": "\xff"}', headers=head)
    assert damaged.status_code == 400 and damaged.json()["error"]["code"] == "bad_request"
    assert served.client.get("/v1/info").json()["source"]["fields"]["method"] == "paper"


def test_a_live_source_that_stalls_says_so_and_the_doorway_is_lost(serve: Serve) -> None:
    tap = Tap(live=True)
    served = serve(source=("tap", lambda: tap))
    tap.wanted.release()
    wait_for(lambda: served.state.live.frames)
    assert served.state.live.get(1).decision.reason == "turn"
    wait_for(lambda: served.client.get("/v1/decision").json()["reason"] == "lost")
    assert served.client.get("/healthz").json()["status"] == "degraded"
    tap.wanted.release()
    wait_for(lambda: served.client.get("/healthz").json()["status"] == "ok")


def test_a_camera_that_contradicts_the_room_is_warned_of(
    serve: Serve, tap: Tap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("doorway3ds.live.lens._EVERY_S", 0.0)
    room = read_image(EXAMPLES / "doorway.jpg").image
    camera = Camera.from_fov(640, 480, 80)
    monkeypatch.setattr(tap, "frame", lambda: View(camera).frame(room, time.monotonic()))
    served = serve(source=("tap", lambda: tap))
    with served.client.stream("GET", "/v1/stream") as answer:
        warned = []
        for kind, data in events(answer):
            tap.wanted.release()
            if kind == "source":
                warned.append(data["warning"])
            if warned[-1:] != [None]:
                break
    assert None in warned and "has a focal length of 381 px" in warned[-1]
    assert served.client.get("/v1/info").json()["source"]["warning"] == warned[-1]


def test_a_source_that_is_gone_is_told_and_closed(served: Served, tap: Tap) -> None:
    tap.wanted.release()
    wait_for(lambda: served.state.live.frames == 1)
    tap.lost = True
    tap.wanted.release()
    wait_for(lambda: served.state.live.state == "lost")
    source = served.client.get("/v1/info").json()["source"]
    assert source["problem"] == "the tap is dry"
    assert served.client.get("/v1/decision").json()["reason"] == "lost"
    assert tap.closed


def test_too_many_streams_are_refused(serve: Serve, tap: Tap) -> None:
    served = serve(source=("tap", lambda: tap), limits={"streams": 1})
    with served.client.stream("GET", "/v1/stream") as answer:
        lines = answer.iter_lines()
        next(lines)
        refused = httpx.get(f"{served.url}/v1/stream")
        assert refused.status_code == 429
        assert refused.headers["retry-after"]


def test_the_end_closes_streams_and_source(serve: Serve, tap: Tap) -> None:
    served = serve(source=("tap", lambda: tap))
    with served.client.stream("GET", "/v1/stream") as answer:
        lines = answer.iter_lines()
        next(lines)
        start = time.monotonic()
        served.stop()
        assert time.monotonic() - start < 15
        assert not any(line.startswith("event: decision") for line in lines)
    assert tap.closed
