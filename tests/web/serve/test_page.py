"""The page in a real Chromium."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.web.base import tls
from tests.factories import encode, scene
from tests.web.browser import Page, needs_browser
from tests.web.conftest import Serve, Served

pytestmark = needs_browser


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
    weakest = page.weakest_contrast(theme)
    assert weakest[0] >= 4.5, weakest


@pytest.mark.parametrize(("width", "height"), [(900, 1200), (1512, 2016)])
def test_large_pictures_from_phones_are_taken(
    shared: Served, page: Page, width: int, height: int
) -> None:
    page.open(shared.url)
    page.problems()  # of the page before, whose server may have ended under it
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


@pytest.mark.parametrize("width", [390, 1280])
def test_the_answers_reason_leads_to_its_section(
    shared: Served, page: Page, photo: bytes, width: int
) -> None:
    page.open(shared.url, width)
    page.problems()
    page.give(photo, "drop")
    link = page.until(
        lambda: page.run(
            "const a = document.querySelector('#facts a'); return a && [a.text, a.href]"
        )
    )
    assert link == ["turn", f"{shared.url}/reasons#turn"]
    page.driver.get(f"{shared.url}/reasons#turn")
    assert page.run("return document.querySelector(':target').textContent") == "turn"
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")
    assert page.problems() == []


@pytest.mark.parametrize("width", [390, 1280])
def test_the_api_is_shown_without_anything_from_elsewhere(
    shared: Served, page: Page, width: int
) -> None:
    page.open(shared.url, width)
    page.problems()
    page.driver.get(f"{shared.url}/docs")
    page.until(lambda: page.run("return document.querySelectorAll('.route').length") == 15)
    shown = str(page.run("return document.getElementById('post-/v1/decide').textContent"))
    for words in ("Decide on one image", "fov_deg", "number, 1 to 179", "turn_deg", "image/jpeg"):
        assert words in shown
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")
    loaded = page.run(
        "return performance.getEntriesByType('resource').map((e) => new URL(e.name).origin)"
    )
    assert set(loaded) == {shared.url}  # type: ignore[call-overload]
    assert page.problems() == []
