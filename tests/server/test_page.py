"""The page in a real Chromium."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.server import tls
from tests.pictures import encode, scene
from tests.server.conftest import Serve, Served, wait_for

_CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
_DRIVER = shutil.which("chromedriver")

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(_CHROMIUM is None, reason="Chromium is not installed"),
    pytest.mark.skipif(_DRIVER is None, reason="Chromium's driver is not installed"),
    pytest.mark.skipif(find_spec("selenium") is None, reason="selenium is not installed"),
]

_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-fake-device-for-media-stream",
    "--use-fake-ui-for-media-stream",
    "--host-resolver-rules=MAP doorbot.test 127.0.0.1",
)
_SECONDS = 60  # a machine at work may take its time


class Page:
    """A browser with one page; says what a person would read on it."""

    def __init__(self, folder: Path) -> None:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service

        options = webdriver.ChromeOptions()
        options.binary_location = _CHROMIUM or ""
        for flag in (*_FLAGS, f"--user-data-dir={folder}"):
            options.add_argument(flag)
        # The certificate made on the spot: a person would accept it once.
        options.accept_insecure_certs = True
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service(_DRIVER))

    def open(self, url: str, width: int = 1280, height: int = 900) -> None:
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600},
        )
        self.driver.get(url)
        self.until(lambda: self.run("return document.body.dataset.mode"))

    def run(self, script: str, *arguments: object) -> object:
        return self.driver.execute_script(script, *arguments)

    def text(self, element: str) -> str:
        return str(self.run(f"return document.getElementById('{element}').textContent"))

    def click(self, element: str) -> None:
        self.run(f"document.getElementById('{element}').click()")

    def mode(self, name: str) -> None:
        self.run(f"document.querySelector('#modes [value={name}]').click()")

    def marks(self) -> int:
        found = self.run("return document.querySelectorAll('#marks .m-best').length")
        return int(str(found))

    def until(self, what: Callable[[], object]) -> object:
        return wait_for(what, _SECONDS)

    def give(self, data: bytes, event: str) -> None:
        """A picture dropped on or pasted into the page."""
        self.run(
            """
            const [bytes, kind] = arguments;
            const file = new File([new Uint8Array(bytes)], "room.jpg", { type: "image/jpeg" });
            const transfer = new DataTransfer();
            transfer.items.add(file);
            const event = kind === "drop"
              ? new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true })
              : new ClipboardEvent("paste", { clipboardData: transfer, bubbles: true });
            document.getElementById("stage").dispatchEvent(event);
            """,
            list(data),
            event,
        )

    def problems(self) -> list[str]:
        return [entry["message"] for entry in self.driver.get_log("browser")]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    opened = Page(tmp_path_factory.mktemp("browser"))
    yield opened
    opened.driver.quit()


@pytest.mark.parametrize("event", ["drop", "paste"])
def test_a_picture_is_decided_on(shared: Served, page: Page, photo: bytes, event: str) -> None:
    page.open(shared.url)
    page.give(photo, event)
    page.until(lambda: page.text("headline") == "Turn left 13.2°")
    assert page.marks() == 2
    assert page.text("turn") == "13.2° left"
    assert page.text("chance-figure") == "0.95"
    assert "Bearing" in page.text("facts")
    assert page.problems() == []


def test_settings_decide_again(shared: Served, page: Page, photo: bytes) -> None:
    page.open(shared.url)
    page.give(photo, "drop")
    page.until(lambda: page.text("turn") == "13.2° left")
    page.run(
        """
        const form = document.getElementById("settings");
        form.camera.value = "fov";
        form.fov_deg.value = "30";
        form.dispatchEvent(new Event("input", { bubbles: true }));
        """
    )
    page.until(lambda: page.text("turn") == "6.1° left")
    page.run(
        """
        const form = document.getElementById("settings");
        form.method.value = "paper";
        form.dispatchEvent(new Event("input", { bubbles: true }));
        """
    )
    page.until(lambda: "Best-Pixel" in page.text("facts"))
    assert page.problems() == []


def test_what_is_no_picture_is_said(shared: Served, page: Page) -> None:
    page.open(shared.url)
    page.give(b"no picture at all", "drop")
    page.until(lambda: "picture is not" in page.text("note") or "image" in page.text("note"))
    assert page.marks() == 0
    page.problems()  # the refused request is listed


def test_both_downloads(shared: Served, page: Page, photo: bytes) -> None:
    page.open(shared.url)
    page.run(
        """
        window.saved = [];
        const blobs = new Map();
        const make = URL.createObjectURL.bind(URL);
        URL.createObjectURL = (blob) => {
          const url = make(blob);
          blobs.set(url, blob);
          return url;
        };
        HTMLAnchorElement.prototype.click = function () {
          const { download, href } = this;
          blobs.get(href).text().then((text) => saved.push([download, text.slice(0, 9999)]));
        };
        """
    )
    page.give(photo, "drop")
    page.until(lambda: page.text("turn") == "13.2° left")
    page.click("save-json")
    page.click("save-picture")
    page.until(lambda: page.run("return saved.length") == 2)
    saved = dict(page.run("return saved"))  # type: ignore[call-overload]
    assert json.loads(saved["room_3ds.json"])["reason"] == "turn"
    assert "JFIF" in saved["room_3ds.jpg"][:20]


def test_the_browsers_camera_under_another_name(serve: Serve, page: Page, tmp_path: Path) -> None:
    token = "correct-horse"
    made = tls.self_signed(tmp_path, ("doorbot.test",))
    served = serve(certificate=made, token=token)
    page.open(f"https://doorbot.test:{served.port}/?token={token}")
    assert page.run("return [location.hostname, location.search, isSecureContext]") == [
        "doorbot.test",
        "",
        True,
    ]
    page.mode("camera")
    page.click("welcome-button")
    page.until(lambda: page.text("headline").startswith("Turn left"))
    page.until(lambda: "a second" in page.text("pace"))
    assert page.run("return document.getElementById('video').videoWidth") > 0  # type: ignore[operator]
    assert page.marks() == 2
    page.click("toggle")
    page.until(lambda: page.text("toggle") == "Start the camera")
    assert page.problems() == []


def test_a_video_is_followed(serve: Serve, page: Page, tmp_path: Path) -> None:
    film = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 10, (160, 120))
    for number in range(20):
        writer.write(np.roll(scene(160, 120), 4 * number, axis=1)[..., ::-1].copy())
    writer.release()
    from doorway3ds.sources import open_source

    def opened() -> object:
        return open_source(str(film), pace=True, loop=True)

    served = serve(source=("film.avi", opened))
    page.open(served.url)
    page.until(lambda: page.text("headline") not in ("Ready", ""))
    first = page.run("return document.getElementById('photo').src")
    page.until(lambda: page.run("return document.getElementById('photo').src") != first)
    page.until(lambda: page.run("return document.querySelectorAll('#history .h-line').length"))
    assert page.problems() == []


@pytest.mark.parametrize("width", [360, 390, 768, 1024, 1440])
def test_nothing_sticks_out(shared: Served, page: Page, photo: bytes, width: int) -> None:
    page.open(shared.url, width, 800)
    page.give(photo, "drop")
    page.until(lambda: page.text("turn") == "13.2° left")
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")


def test_every_control_is_reached_by_the_keyboard_and_has_a_name(
    shared: Served, page: Page, photo: bytes
) -> None:
    from selenium.webdriver.common.keys import Keys

    page.open(shared.url)
    page.give(photo, "drop")
    page.until(lambda: page.text("turn") == "13.2° left")
    page.run("document.getElementById('settings-box').open = true; document.body.focus()")
    reached = set()
    for _ in range(40):
        page.driver.switch_to.active_element.send_keys(Keys.TAB)
        reached.add(
            page.run(
                "const e = document.activeElement;"
                "return e.id || e.name && `${e.name}=${e.type === 'checkbox' ? e.value : ''}`"
                " || e.value || e.tagName"
            )
        )
        time.sleep(0.01)
    assert {"theme", "choose", "save-json", "save-picture"} <= reached
    assert {"method=", "network=", "camera=", "height_m="} <= reached
    unnamed = page.run(
        """
        return [...document.querySelectorAll("button, select, input")].filter((e) =>
          e.offsetParent && !e.labels?.length && !e.ariaLabel && !e.textContent.trim()
        ).map((e) => e.outerHTML);
        """
    )
    assert unnamed == []


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_text_stands_out_from_its_ground(
    shared: Served, page: Page, photo: bytes, theme: str
) -> None:
    page.open(shared.url)
    page.give(photo, "drop")
    page.until(lambda: page.text("turn") == "13.2° left")
    weakest = page.run(
        """
        document.documentElement.dataset.theme = arguments[0];
        const canvas = document.createElement("canvas");
        const probe = canvas.getContext("2d", { willReadFrequently: true });
        const rgb = (color) => {
          probe.clearRect(0, 0, 1, 1);
          probe.fillStyle = color;
          probe.fillRect(0, 0, 1, 1);
          return probe.getImageData(0, 0, 1, 1).data;
        };
        const light = (color) => [...rgb(color)].slice(0, 3).map((c) => c / 255)
          .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
          .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
        const ground = (e) => {
          for (; e; e = e.parentElement) {
            const color = getComputedStyle(e).backgroundColor;
            if (rgb(color)[3] > 250) return color;
          }
          return "white";
        };
        let found = [99, ""];
        const texts = "h1, h2, h3, p, span, output, dt, dd, button, a, label";
        for (const e of document.querySelectorAll(texts)) {
          if (!e.offsetParent || e.closest("#tags") || e.disabled) continue;
          if (![...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())) continue;
          const pair = [light(getComputedStyle(e).color), light(ground(e))].sort((a, b) => b - a);
          const ratio = (pair[0] + 0.05) / (pair[1] + 0.05);
          if (ratio < found[0]) found = [ratio, e.outerHTML.slice(0, 120)];
        }
        return found;
        """,
        theme,
    )
    assert weakest[0] >= 4.5, weakest  # type: ignore[index]


@pytest.mark.parametrize(("width", "height"), [(900, 1200), (3024, 4032)])
def test_large_pictures_from_phones_are_taken(
    shared: Served, page: Page, width: int, height: int
) -> None:
    page.open(shared.url)
    page.give(encode(scene(width, height), orientation=6), "drop")
    page.until(lambda: page.text("headline").startswith("Turn left"))
    # EXIF says that it lies on its side, for the server and for the browser alike.
    box = page.run("return document.getElementById('marks').getAttribute('viewBox')")
    assert str(box).split()[2:] == [str(height), str(width)]
    size = page.run(
        "const p = document.getElementById('photo'); return [p.naturalWidth, p.naturalHeight]"
    )
    assert size == [height, width]
    assert page.marks() == 2
    # However large, it is shown within the window.
    shown = page.run(
        "const b = document.getElementById('photo').getBoundingClientRect();"
        "return [b.left >= 0, b.right <= innerWidth]"
    )
    assert shown == [True, True]
    assert page.problems() == []
