"""A guided calibration by a board rendered through a known lens, over HTTP and on the page."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from doorway3ds.camera import calibration
from doorway3ds.camera.guide import COLUMNS, FEWEST, ROWS, SPREAD, TILTS
from doorway3ds.camera.info import read_camera_info
from doorway3ds.sources import open_source
from doorway3ds.sources.base import Source, View
from doorway3ds.types import Frame
from tests.camera.test_calibration import CHESS, check, photograph
from tests.camera.test_guide import POSES, film
from tests.web.browser import Page, needs_browser
from tests.web.conftest import Serve, Served, wait_for
from tests.web.serve.test_live import Tap

SECONDS = 240  # on a machine at work


@pytest.fixture(scope="module")
def shots() -> list[np.ndarray]:
    """Each is taken; the first ones cover zones, tilts and distances."""
    return [photograph(CHESS, pose) for pose in POSES[:FEWEST]]


class Hand(Source):
    """Holds the board before a camera, and moves on to the next pose once one was taken."""

    live = True

    def __init__(self, shots: list[np.ndarray]) -> None:
        super().__init__("hand")
        self.shots, self.pose, self.judged = shots, 0, None
        self.told: Callable[[], dict] = dict

    def read(self, timeout_s: float | None = None) -> Frame | None:
        # The next frame only once this one was looked at, which leaves time for it.
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            time.sleep(0.02)
            told = self.told()
            if told.get("frame") not in (None, self.judged):
                self.judged = told["frame"]
                self.pose = told["frames"]["taken"]  # not by the verdict, which may be of the last
                break
        return View().frame(self.shots[self.pose % len(self.shots)], time.monotonic())

    def close(self) -> None:
        self.ended = True


@pytest.fixture
def hand(shots: list[np.ndarray]) -> Hand:
    return Hand(shots)


@pytest.fixture
def served(serve: Serve, hand: Hand) -> Served:
    made = serve(source=("hand", lambda: hand), token="correct-horse")
    hand.told = lambda: made.state.calibration.to_dict() if made.state.calibration else {}
    return made


def state_of(client: httpx.Client) -> dict:
    return client.get("/v1/calibration").json()


def begin(client: httpx.Client, **fields: object) -> httpx.Response:
    return client.post("/v1/calibration", json=fields)


def test_the_lens_is_found_while_the_source_goes_on(served: Served, tmp_path: Path) -> None:
    assert state_of(served.client) == {"state": "none"}
    assert begin(served.client, name="head").json()["state"] == "taking"
    second = begin(served.client)
    assert (second.status_code, second.json()["error"]["code"]) == (409, "calibrating")

    seen: list[dict] = []

    def over() -> bool:
        time.sleep(0.1)
        seen.append(state_of(served.client))
        return seen[-1]["state"] not in ("taking", "computing")

    before = served.state.live.frames
    wait_for(over, SECONDS)
    done = seen[-1]
    assert done["state"] == "done", done["problem"]
    assert served.state.live.frames > before

    half = next(told for told in seen if told["frames"]["taken"] >= 4)
    assert half["size"] == [640, 480]
    assert half["next"] and half["verdict"]
    outline = next(told["seen"] for told in seen if told["seen"])
    assert np.all(np.array(outline) > 0) and np.all(np.array(outline) < (640, 480))
    taken = [told["frames"]["taken"] for told in seen]
    assert taken == sorted(taken) and taken[-1] >= FEWEST
    assert done["zones"]["covered"] == list(range(COLUMNS * ROWS))
    assert done["tilts"] == dict.fromkeys(TILTS, True)
    assert done["distances"]["spread"] >= SPREAD
    result = done["result"]
    assert result["rms_px"] < 0.3 and result["doubts"] == []
    assert result["frames"] == taken[-1]

    answer = served.client.get("/v1/calibration/camera.yaml")
    assert answer.headers["content-disposition"] == 'attachment; filename="head.yaml"'
    saved = tmp_path / "head.yaml"
    saved.write_bytes(answer.content)
    camera = read_camera_info(saved)
    check(camera)
    assert camera.name == "head"

    assert served.client.delete("/v1/calibration").json() == {"state": "none"}
    assert served.client.get("/v1/calibration/camera.yaml").status_code == 404


def test_it_finishes_early_if_asked_and_says_what_is_lacking(served: Served) -> None:
    early = served.client.post("/v1/calibration/finish")
    assert early.json()["error"]["code"] == "not_calibrating"
    begin(served.client)
    few = served.client.post("/v1/calibration/finish")
    assert (few.status_code, few.json()["error"]["code"]) == (409, "too_few_frames")
    wait_for(lambda: state_of(served.client)["frames"]["taken"] >= 4, SECONDS)
    assert served.client.post("/v1/calibration/finish").status_code == 200
    wait_for(lambda: state_of(served.client)["state"] == "done", SECONDS)
    result = state_of(served.client)["result"]
    assert 4 <= result["frames"] < FEWEST
    assert result["fx"] == pytest.approx(540, rel=0.03)


def test_a_calibration_dropped_while_it_computes_is_never_shown(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    released, ended, fits = threading.Event(), threading.Event(), []
    fit = calibration._fit

    def held(*given: Any) -> Any:
        fits.append(given)
        released.wait(60)
        try:
            return fit(*given)
        finally:
            ended.set()

    monkeypatch.setattr(calibration, "_fit", held)
    begin(served.client, name="old")
    wait_for(lambda: state_of(served.client)["frames"]["taken"] >= 4, SECONDS)
    served.client.post("/v1/calibration/finish")
    wait_for(lambda: len(fits) == 1, SECONDS)
    old = served.state.calibration
    assert old is not None and state_of(served.client)["state"] == "computing"

    assert served.client.delete("/v1/calibration").json() == {"state": "none"}
    assert begin(served.client, name="new").json()["state"] == "taking"
    released.set()
    wait_for(ended.is_set, SECONDS)
    wait_for(lambda: state_of(served.client)["frame"] is not None, SECONDS)
    assert len(fits) == 1  # of the other fits none has begun
    assert old.found is None and old.state != "done"
    told = state_of(served.client)
    assert (told["state"], told["fields"]["name"], told["result"]) == ("taking", "new", None)
    assert served.client.get("/v1/calibration/camera.yaml").status_code == 404


def test_a_film_turned_upright_fails_with_the_reason(
    serve: Serve, tmp_path: Path, shots: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("doorway3ds.sources.video.orientation", lambda reader: 3)
    path = film(tmp_path / "board.avi", shots[:2])
    opened = partial(open_source, str(path), pace=True, loop=True)
    served = serve(source=("board.avi", opened))
    begin(served.client)
    wait_for(lambda: state_of(served.client)["state"] == "failed")
    assert "turned upright" in state_of(served.client)["problem"]
    assert begin(served.client).json()["state"] == "taking"  # another try is allowed


def test_a_silent_source_is_named_and_a_server_that_ends_does_not_wait(serve: Serve) -> None:
    served = serve(source=("tap", lambda: Tap(live=True)))
    begin(served.client)
    wait_for(lambda: state_of(served.client)["problem"] == "no image arrives")
    served.stop()


@pytest.mark.parametrize(
    "fields",
    [
        {"board": "9"},
        {"board": "2x6"},
        {"board": "9x6", "square_mm": 0},
        {"square_mm": "25"},
        {"marker_mm": 18},  # of a chessboard
        {"charuco": True, "square_mm": 20, "marker_mm": 30},
        {"charuco": True, "dictionary": "DICT_NONE"},
        {"charuco": True, "board": "40x40"},  # more markers than the dictionary has
        {"name": "../camera"},
        {"else": 1},
    ],
)
def test_wrong_boards_are_refused(served: Served, fields: dict[str, object]) -> None:
    refused = begin(served.client, **fields)
    assert refused.status_code == 422, refused.text
    assert state_of(served.client) == {"state": "none"}


def test_who_may_not_enter_and_bodies_that_are_too_large(served: Served, shared: Served) -> None:
    with httpx.Client(base_url=served.url) as stranger:
        for method, path in (
            ("GET", ""),
            ("POST", ""),
            ("DELETE", ""),
            ("POST", "/finish"),
            ("GET", "/camera.yaml"),
            ("GET", "/board.pdf"),
        ):
            assert stranger.request(method, f"/v1/calibration{path}").status_code == 401
    foreign = {"Origin": "https://elsewhere.example"}
    assert served.client.post("/v1/calibration", json={}, headers=foreign).status_code == 403
    assert served.client.delete("/v1/calibration", headers=foreign).status_code == 403
    large = served.client.post("/v1/calibration", content=b" " * (2**25 + 1))
    assert large.status_code == 413
    assert begin(shared.client).json()["error"]["code"] == "no_source"


def test_the_board_is_a_page_to_print(shared: Served) -> None:
    page = shared.client.get("/v1/calibration/board.pdf?charuco=true&board=8x6")
    assert page.headers["content-type"] == "application/pdf"
    assert page.content.startswith(b"%PDF")
    large = shared.client.get("/v1/calibration/board.pdf?square_mm=90")
    assert large.status_code == 422 and "do not fit on A4" in large.text


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    opened = Page(tmp_path_factory.mktemp("browser"))
    yield opened
    opened.driver.quit()


def shown(page: Page, *elements: str) -> Callable[[], bool]:
    """Whether all of them are in sight."""
    script = "return arguments[0].every((id) => document.getElementById(id).offsetParent)"
    return lambda: bool(page.run(script, list(elements)))


class TestPage:
    pytestmark = needs_browser

    def test_it_guides_survives_a_reload_and_goes_back_to_live(
        self, served: Served, hand: Hand, page: Page
    ) -> None:
        hand.shots = hand.shots[:4]  # all parts of the image, and three of four tilts
        page.until(lambda: served.client.get("/v1/decision").is_success)  # the first image came
        page.open(f"{served.url}/?token=correct-horse")
        page.mode("calibrate")
        page.until(lambda: page.text("headline") == "Calibrate this camera")
        page.until(shown(page, "board", "coverage", "photo"))
        assert not shown(page, "turn")()
        pdf = str(page.run("return document.getElementById('board-pdf').href"))
        assert served.client.get(pdf).content.startswith(b"%PDF")
        page.click("calibrate-start")
        page.until(lambda: page.run("return document.querySelector('#marks .c-seen')"))
        page.until(shown(page, "calibrate-finish", "calibrate-drop"))
        covered = "return document.querySelectorAll('#coverage-zones .covered').length"
        page.until(lambda: page.run(covered))

        page.open(served.url)
        assert page.run("return document.body.dataset.mode") == "calibrate"
        page.until(lambda: page.run(covered))
        page.until(lambda: page.text("coverage-frames") == f"4 of {FEWEST} images")
        page.click("calibrate-finish")
        page.until(shown(page, "calibrate-file"))
        assert page.text("headline").startswith("Calibrated to 0.")
        assert "Lens model" in page.text("calibrated")
        assert page.text("zones-said") == f"{COLUMNS * ROWS} of {COLUMNS * ROWS}"
        assert page.text("tilts-said") == "up missing"
        assert "next would be: tilt it to face up" in page.text("doubts")

        page.open(served.url)
        page.until(shown(page, "calibrate-file"))
        page.mode("source")
        page.until(shown(page, "turn", "pause"))
        page.until(lambda: "a second" in page.text("pace"))
        assert not shown(page, "calibrate-file")()
        page.mode("calibrate")
        page.until(shown(page, "calibrate-drop"))
        page.click("calibrate-drop")
        page.until(shown(page, "board"))
        assert page.problems() == []

    @pytest.mark.parametrize("width", [360, 768, 1440])
    def test_nothing_sticks_out_and_all_can_be_read(
        self, served: Served, page: Page, width: int
    ) -> None:
        begin(served.client)
        page.open(f"{served.url}/?token=correct-horse", width, 800)
        page.until(lambda: page.run("return document.querySelector('#marks .c-seen')"))
        assert page.run("return document.documentElement.scrollWidth <= innerWidth")
        for theme in ("light", "dark"):
            weakest = page.weakest_contrast(theme)
            assert weakest[0] >= 4.5, weakest

    def test_a_wrong_board_is_named(self, served: Served, page: Page) -> None:
        page.open(f"{served.url}/?token=correct-horse")
        page.mode("calibrate")
        page.until(shown(page, "board"))
        page.run("document.getElementById('board').board.value = '2x6'")
        page.click("calibrate-start")
        page.until(lambda: "at least 3x3" in page.text("board-problem"))
