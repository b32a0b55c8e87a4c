"""The page once nothing fresh comes: whatever the cause, it must not go on ordering."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.sources import open_source
from tests.factories import encode, scene
from tests.web.browser import Page, needs_browser
from tests.web.conftest import Serve, Served, wait_for
from tests.web.serve.test_live import Tap

pytestmark = needs_browser
WITHIN_S = 3.0


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    opened = Page(tmp_path_factory.mktemp("browser"))
    yield opened
    opened.driver.quit()


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (160, 120))
    for number in range(20):
        # One block of grey levels tells the frames apart, also after JPEG.
        picture = scene(160, 120)
        picture[:40, :40] = 10 * number
        writer.write(picture[..., ::-1].copy())
    writer.release()
    return path


@pytest.fixture
def process(network: Path, film: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`3ds serve` in a process of its own, and its address."""
    code = "from doorway3ds.cli.main import main; main()"
    options = ("serve", str(film), "--loop", "--port", "0", "--network", str(network))
    with subprocess.Popen(
        [sys.executable, "-c", code, *options], stdout=subprocess.PIPE, text=True
    ) as started:
        assert started.stdout is not None
        yield started, started.stdout.readline().split()[-1]
        started.kill()


def clock(page: Page) -> float:
    """Now; from now on the page notes when its headline changes, however busy the machine is."""
    page.run(
        """
        window.changed = {};
        const line = document.getElementById("headline");
        new MutationObserver(() => { changed[line.textContent] ??= Date.now() / 1000; })
          .observe(line, { childList: true, characterData: true, subtree: true });
        """
    )
    return time.time()


def quiet(page: Page, headline: str, since: float) -> None:
    """Within three seconds the page says `headline`, and nothing that could be obeyed."""
    page.until(lambda: page.text("headline") == headline)
    assert page.orders() == []
    changed = page.run("return changed[arguments[0]] ?? 0", headline)
    assert float(str(changed)) - since < WITHIN_S


def feed(page: Page, tap: Tap) -> None:
    """Frames until the tracker is sure."""

    def turns() -> bool:
        tap.wanted.release()
        time.sleep(0.1)
        return page.text("headline").startswith("Turn left")

    page.until(turns)


@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP])
def test_a_server_that_dies_ceases_to_order(
    process: tuple[subprocess.Popen[str], str], page: Page, blow: signal.Signals
) -> None:
    server, url = process
    page.open(url)
    page.until(lambda: page.text("headline").startswith("Turn left"))
    page.until(lambda: "a second" in page.text("pace"))
    since = clock(page)
    server.send_signal(blow)
    quiet(page, "No answer", since)
    time.sleep(1.5)
    assert page.orders() == []
    if blow == signal.SIGSTOP:
        server.send_signal(signal.SIGCONT)
        page.until(lambda: page.text("headline").startswith("Turn left"))
        assert "colours" in page.orders()


@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGTERM])
def test_so_does_the_browsers_own_camera(
    process: tuple[subprocess.Popen[str], str], page: Page, blow: signal.Signals
) -> None:
    server, url = process
    page.open(url)
    page.mode("camera")
    page.click("welcome-button")
    page.until(lambda: page.text("headline").startswith("Turn left"))
    since = clock(page)
    server.send_signal(blow)
    quiet(page, "No answer", since)
    assert page.text("sentence") == "The server does not answer."


def test_a_source_that_is_lost_ceases_to_order(serve: Serve, page: Page) -> None:
    tap = Tap(live=True)
    served = serve(source=("tap://kitchen", lambda: tap))
    page.open(served.url)
    feed(page, tap)
    assert page.text("origin") == "tap://kitchen"
    since = clock(page)
    tap.lost = True
    tap.wanted.release()
    quiet(page, "No answer", since)
    assert page.text("sentence") == "The tap is dry."


def test_a_source_that_stalls_or_ends_ceases_to_order(serve: Serve, page: Page, film: Path) -> None:
    tap = Tap()
    served = serve(source=("tap", lambda: tap))
    page.open(served.url)
    feed(page, tap)
    quiet(page, "No answer", clock(page))
    feed(page, tap)
    served = serve(source=("film", lambda: open_source(str(film), pace=True)))
    page.open(served.url)
    page.until(lambda: page.text("headline") == "Ended")
    assert page.orders() == []


def test_a_page_that_slept_waits_for_something_new(serve: Serve, page: Page, film: Path) -> None:
    served = serve(source=("film", lambda: open_source(str(film), pace=True, loop=True)))
    page.open(served.url)
    page.until(lambda: page.text("headline").startswith("Turn left"))
    since = clock(page)
    page.hide(True)
    quiet(page, "No answer", since)
    time.sleep(0.5)
    assert page.orders() == []
    page.hide(False)
    page.until(lambda: page.text("headline").startswith("Turn left"))


def decided(page: Page, served: Served, photo: bytes) -> None:
    page.open(served.url)
    page.give(photo, "drop")
    page.until(lambda: page.text("turn") == "13.2° left")


def _wrong_kind(page: Page, served: Served) -> None:
    page.give(b"# Read me", "drop", "README.md")


def _wrong_bytes(page: Page, served: Served) -> None:
    page.give(b"# Read me", "drop", "README.jpg")


def _unknown_kind(page: Page, served: Served) -> None:
    page.give(b"# Read me", "drop", "README")


def _empty(page: Page, served: Served) -> None:
    page.give(b"", "drop", "empty.jpg")


def _unreadable(page: Page, served: Served) -> None:
    """As a folder, which a browser hands over as a file without a kind."""
    page.run(
        """
        const whole = Blob.prototype.arrayBuffer;
        Blob.prototype.arrayBuffer = function () {
          Blob.prototype.arrayBuffer = whole;
          return Promise.reject(new DOMException("it is a folder", "NotFoundError"));
        };
        """
    )
    page.give(b"# Read me", "drop", "album")


@pytest.mark.parametrize(
    ("give", "words"),
    [
        (_empty, "empty.jpg is empty."),
        (_unreadable, "album cannot be read. Is it a folder, or a file that has changed?"),
        (_wrong_kind, "README.md is not an image."),
        (_wrong_bytes, "README.jpg is not an image; expected one of"),
        (_unknown_kind, "README is not an image; expected one of"),
    ],
)
def test_a_wrong_file_takes_the_last_answer_away(
    shared: Served, page: Page, photo: bytes, give: Callable[[Page, Served], None], words: str
) -> None:
    decided(page, shared, photo)
    since = clock(page)
    give(page, shared)
    quiet(page, "No answer", since)
    assert page.text("sentence").startswith(words)
    page.problems()  # the refused request is listed


def test_a_refused_request_takes_the_last_answer_away(
    serve: Serve, page: Page, photo: bytes
) -> None:
    served = serve(limits={"max_bytes": 30_000})
    decided(page, served, photo)
    rng = np.random.default_rng(0)
    noise = encode(rng.integers(0, 255, (400, 400, 3), dtype=np.uint8))
    assert len(noise) > 30_000
    since = clock(page)
    page.give(noise, "drop", "noise.jpg")
    quiet(page, "No answer", since)
    assert page.text("sentence") == "noise.jpg is larger than the server takes."
    page.problems()


def test_of_several_pictures_it_says_which_one_counts(
    shared: Served, page: Page, photo: bytes
) -> None:
    page.open(shared.url)
    page.give(photo, "drop", "notes.md", "one.jpg", "two.jpg")
    page.until(lambda: page.text("turn") == "13.2° left")
    page.until(lambda: page.text("note") == "3 files came; only one.jpg is looked at.")
    assert page.text("origin") == "one.jpg"


def test_while_paused_both_files_are_of_the_frame_in_sight(
    serve: Serve, page: Page, film: Path
) -> None:
    served = serve(source=("film", lambda: open_source(str(film), pace=True, loop=True)))
    page.open(served.url)
    page.run(
        """
        window.saved = {};
        const blobs = new Map();
        const make = URL.createObjectURL.bind(URL);
        URL.createObjectURL = (blob) => {
          const url = make(blob);
          blobs.set(url, blob);
          return url;
        };
        HTMLAnchorElement.prototype.click = function () {
          const { download, href } = this;
          blobs.get(href).arrayBuffer().then((b) => { saved[download] = [...new Uint8Array(b)]; });
        };
        """
    )
    page.until(lambda: page.text("headline").startswith("Turn left"))
    page.click("pause")
    assert page.text("headline") == "Paused"
    assert page.text("sentence").startswith("This frame: Turn left")
    time.sleep(1.5)  # far more than the frames that the server keeps
    assert page.text("headline") == "Paused"
    grey = page.run(
        """
        const c = document.createElement("canvas").getContext("2d");
        c.drawImage(document.getElementById("photo"), 0, 0);
        return c.getImageData(20, 20, 1, 1).data[0];
        """
    )
    page.click("save-json")
    page.click("save-picture")
    page.until(lambda: page.run("return Object.keys(saved).length") == 2)
    files = dict(page.run("return saved"))  # type: ignore[call-overload]
    (told,) = [bytes(data) for name, data in files.items() if name.endswith(".json")]
    (page_picture,) = [bytes(data) for name, data in files.items() if name.endswith(".jpg")]
    number = json.loads(told)["frame"]
    assert set(files) == {f"frame-{number}_3ds.json", f"frame-{number}_3ds.jpg"}
    drawn = cv2.imdecode(np.frombuffer(page_picture, np.uint8), cv2.IMREAD_COLOR)
    nearest = np.abs(drawn.reshape(-1, 3).astype(int) - int(str(grey))).max(axis=1)
    assert (nearest <= 3).sum() > 2000  # the block of that frame's grey is in it
    page.click("pause")
    page.until(lambda: page.text("headline").startswith("Turn left"))


def test_figures_can_be_selected_while_frames_come(serve: Serve, page: Page, film: Path) -> None:
    served = serve(source=("film", lambda: open_source(str(film), pace=True, loop=True)))
    page.open(served.url)
    page.until(lambda: page.text("headline").startswith("Turn left"))
    page.run("getSelection().selectAllChildren(document.querySelector('#facts .fact dd'))")
    selected = page.run("return getSelection().toString()")
    number = served.state.live.frames  # type: ignore[union-attr]
    wait_for(lambda: served.state.live.frames > number + 10)  # type: ignore[union-attr]
    assert page.run("return getSelection().toString()") == selected != ""


def test_a_picture_and_its_marks_change_in_one_paint(serve: Serve, page: Page) -> None:
    tap = Tap()
    served = serve(source=("tap", lambda: tap))
    page.open(served.url)
    feed(page, tap)
    page.run(
        """
        window.seen = [];
        const now = () => ["#photo", "#marks .m-best"].map((name) => document.querySelector(name));
        let last = now();
        const look = () => {
          const next = now();
          const changed = next.map((element, i) => element !== last[i]);
          if (changed.some(Boolean)) seen.push(changed);
          last = next;
          requestAnimationFrame(look);
        };
        look();
        """
    )
    for count in range(1, 5):
        tap.wanted.release()
        page.until(lambda n=count: page.run("return seen.length") == n)  # type: ignore[misc]
    assert page.run("return seen") == [[True, True]] * 4


def test_an_example_is_one_click(shared: Served, page: Page) -> None:
    page.open(shared.url)
    page.run("document.querySelector('#examples button').click()")
    page.until(lambda: page.text("turn") == "13.2° left")
    assert page.text("origin") == "example-doorway.jpg"
