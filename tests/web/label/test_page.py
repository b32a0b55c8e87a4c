"""Labelling in a real Chromium: clicks, keys, what is written, and who else is there."""

from __future__ import annotations

import csv
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.web.browser import Page, needs_browser
from tests.web.label.conftest import Desk

pytestmark = needs_browser


class Labeller(Page):
    """A person at the page of `3ds label`."""

    def begin(self, url: str, width: int = 1280, height: int = 900) -> None:
        self.driver.get("about:blank")  # another #number of the same page loads nothing
        self.problems()  # of the page before, which may have asked a server that has gone
        self.open(url, width, height)

    def press(self, *keys: str) -> None:
        for key in keys:
            self.driver.switch_to.active_element.send_keys(key)

    def at(self, share: float, kind: str = "mouse") -> None:
        """A click or tap at a share of the picture's width."""
        from selenium.webdriver.common.action_chains import ActionChains
        from selenium.webdriver.common.actions.pointer_input import PointerInput

        pointer = PointerInput(kind, kind)
        chain = ActionChains(self.driver, duration=0, devices=[pointer])
        stage = self.driver.find_element("id", "stage")
        # From the element's middle, in whole pixels of the screen.
        chain.move_to_element_with_offset(stage, round((share - 0.5) * stage.rect["width"]), 5)
        chain.click().perform()

    def drag(self, start: float, end: float) -> None:
        from selenium.webdriver.common.action_chains import ActionChains

        stage = self.driver.find_element("id", "stage")
        width = stage.rect["width"]
        chain = ActionChains(self.driver, duration=0)
        chain.move_to_element_with_offset(stage, round((start - 0.5) * width), 0).click_and_hold()
        chain.move_by_offset(round((end - start) * width), 0).release().perform()

    def says(self, element: str, words: str) -> None:
        self.until(lambda: words in self.text(element))

    def saved(self) -> None:
        self.until(lambda: self.text("saved") == "Saved")

    def lines(self, kind: str) -> int:
        return int(str(self.run(f"return document.querySelectorAll('#marks {kind}').length")))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Labeller]:
    opened = Labeller(tmp_path_factory.mktemp("browser"))
    yield opened
    opened.driver.quit()


def rows(site: Path) -> list[dict[str, str]]:
    with (site / "doorways.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def edges(row: dict[str, str]) -> tuple[float, float]:
    return float(row["left_px"]), float(row["right_px"])


def test_clicks_and_keys_become_rows(site: Path, desk: Desk, page: Labeller) -> None:
    page.begin(desk(site).url)
    page.says("name", "a.jpg")
    page.says("saved", "A guess, not saved")
    assert page.lines(".l-edge.guess") == 4  # two edges with their cases
    assert not (site / "doorways.csv").exists()

    page.at(0.3)
    page.says("note", "Now the other edge")
    page.at(0.6)
    page.saved()
    page.press("b", "2")
    page.saved()
    page.press("s")
    page.at(0.95)
    page.at(0.7)
    page.press("h", "w")
    page.saved()
    # 320 pixels of the picture on some 800 of the screen
    first, second = rows(site)
    assert edges(first) == pytest.approx((0.3 * 320, 0.6 * 320), abs=1)
    assert (first["open"], first["clear"], first["confidence"]) == ("1", "0", "2")
    assert (first["second"], first["state"]) == ("0", "open")
    assert edges(second) == pytest.approx((0.7 * 320, 0.95 * 320), abs=1)
    assert (second["clear"], second["confidence"]) == ("1", "3")
    assert (second["second"], second["state"]) == ("1", "half")
    assert page.lines(".l-edge.guess") == 0
    assert page.text("count") == "1 of 5 marked"
    assert page.problems() == []


def test_the_guess_is_taken_by_one_key_and_undone_by_another(
    site: Path, desk: Desk, page: Labeller
) -> None:
    page.begin(desk(site).url)
    page.says("name", "a.jpg")
    page.press("\ue007")  # Enter
    page.says("name", "b.png")
    (taken,) = rows(site)
    assert (taken["image"], taken["state"], taken["confidence"]) == ("a.jpg", "open", "3")
    assert edges(taken) == pytest.approx((0.25 * 320, 0.5 * 320), abs=320 / 32)
    page.press("c")
    page.saved()
    page.press("\ue007")
    page.says("name", "e.jpg")
    assert [row["state"] for row in rows(site)] == ["open", "closed"]
    page.press("z")  # on b.png, whose last change it was
    page.says("name", "b.png")
    page.says("saved", "A guess, not saved")
    page.until(lambda: [row["image"] for row in rows(site)] == ["a.jpg"])
    page.press("z")
    page.says("name", "a.jpg")
    page.until(lambda: rows(site) == [])
    page.press("y")
    page.until(lambda: [row["state"] for row in rows(site)] == ["open"])
    page.press("y")
    page.until(lambda: [row["state"] for row in rows(site)] == ["open", "closed"])
    assert page.problems() == []


def test_what_was_looked_at_and_left_is_not_marked(site: Path, desk: Desk, page: Labeller) -> None:
    page.begin(desk(site).url)
    page.says("name", "a.jpg")
    page.press("\ue014")  # →
    page.says("name", "b.png")
    page.press("n")
    page.saved()
    page.press("u")
    page.says("name", "e.jpg")
    page.press("\ue012", "\ue012")  # ←
    page.says("name", "a.jpg")
    assert [row["image"] for row in rows(site)] == ["b.png"]


def test_a_hasty_key_never_marks_the_picture_that_was_left(
    site: Path, desk: Desk, page: Labeller
) -> None:
    from selenium.webdriver.common.keys import Keys

    page.begin(desk(site).url)
    page.says("name", "a.jpg")
    page.driver.switch_to.active_element.send_keys(Keys.ENTER + "c")
    page.says("name", "b.png")
    page.press("n")
    page.saved()
    page.until(lambda: [row["state"] for row in rows(site)] == ["open", "none"])


def test_it_goes_on_where_it_stopped(site: Path, desk: Desk, page: Labeller) -> None:
    served = desk(site)
    page.begin(served.url)
    page.says("name", "a.jpg")
    page.press("n")
    page.saved()
    served.stop()
    page.begin(desk(site).url)
    page.says("name", "b.png")
    assert page.text("count") == "1 of 5 marked"
    page.press("\ue012")
    page.says("name", "a.jpg")
    page.saved()
    assert page.run("return document.querySelector('[data-key=n]').ariaPressed") == "true"


def test_an_edge_is_dragged_or_typed_and_the_pictures_edge_is_caught(
    site: Path, desk: Desk, page: Labeller
) -> None:
    page.begin(desk(site).url)
    page.says("name", "a.jpg")
    page.at(0.2)
    page.at(0.6)
    page.saved()
    page.drag(0.6, 0.8)
    page.saved()
    page.until(lambda: edges(rows(site)[0]) == pytest.approx((64, 256), abs=1.5))
    page.press("l", "100.5", "\ue007")
    page.until(lambda: edges(rows(site)[0])[0] == 100.5)
    page.drag(101 / 320, 0.002)
    page.until(lambda: edges(rows(site)[0])[0] == -0.5)
    page.press("x")
    page.until(lambda: rows(site)[0]["state"] == "none")
    assert page.problems() == []


def test_a_picture_on_its_side_is_marked_upright_by_taps(
    site: Path, desk: Desk, page: Labeller
) -> None:
    page.begin(f"{desk(site).url}/#5", 390, 844)
    page.says("name", "hall/d.jpg")
    page.until(lambda: page.run("return document.getElementById('photo').naturalWidth"))
    shape = page.run(
        "const p = document.getElementById('photo'); return [p.naturalWidth, p.naturalHeight]"
    )
    assert shape == [180, 240]
    page.at(0.25, "touch")
    page.at(0.75, "touch")
    page.saved()
    (row,) = rows(site)
    assert edges(row) == pytest.approx((0.25 * 180 - 0.5, 0.75 * 180 - 0.5), abs=1)
    assert row["place"] == "hall"
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")
    assert page.problems() == []


def test_two_pages_do_not_destroy_each_others_rows(site: Path, desk: Desk, page: Labeller) -> None:
    served = desk(site)
    page.begin(served.url)
    page.says("name", "a.jpg")
    theirs = {"marks": {"closed": True, "confidence": 1}, "revision": "unmarked"}
    assert served.client.put("/v1/pictures/0", json=theirs).status_code == 200
    page.press("n")
    page.says("note", "Somebody else marked this image")
    page.saved()
    assert [row["state"] for row in rows(site)] == ["closed"]
    assert page.run("return document.querySelector('[data-key=c]').ariaPressed") == "true"
    page.press("y")  # mine, knowing of theirs
    page.until(lambda: [row["state"] for row in rows(site)] == ["none"])
    page.problems()  # the conflict is listed
    page.saved()
    # nor does undo take back what somebody else has written since
    revision = served.client.get("/v1/pictures/0").json()["revision"]
    theirs = {"marks": {"openings": [{"left_px": 9, "right_px": 99}]}, "revision": revision}
    assert served.client.put("/v1/pictures/0", json=theirs).status_code == 200
    page.press("z")
    page.says("note", "Somebody else has marked this image since")
    assert page.lines(".l-edge") == 4
    assert [row["left_px"] for row in rows(site)] == ["9.0"]


def test_marks_wait_on_the_page_until_they_can_be_written(
    site: Path, desk: Desk, page: Labeller
) -> None:
    page.begin(desk(site).url)
    page.says("name", "a.jpg")
    table = site / "doorways.csv"
    table.write_text("somebody,elses\n")
    page.press("c")
    page.says("saved", "Not saved: ")
    page.says("saved", "lacks the column image")
    assert table.read_text() == "somebody,elses\n"
    table.unlink()
    page.saved()
    assert [row["state"] for row in rows(site)] == ["closed"]
    page.problems()


def test_the_links_token_lets_in(site: Path, desk: Desk, page: Labeller) -> None:
    served = desk(site, token="correct-horse")
    page.begin(f"{served.url}/?token=correct-horse")
    page.says("name", "a.jpg")
    page.press("n")
    page.saved()
    assert page.run("return [location.search, document.cookie]") == ["", ""]


def test_a_damaged_picture_is_named_and_passed(site: Path, desk: Desk, page: Labeller) -> None:
    (site / "b.png").write_bytes(b"no image")
    page.begin(f"{desk(site).url}/#2")
    page.says("note", "b.png is not")
    page.press("c", "\ue007")
    page.says("name", "e.jpg")
    assert not (site / "doorways.csv").exists()


@pytest.mark.parametrize("width", [360, 768, 1024, 1440])
def test_nothing_sticks_out(site: Path, desk: Desk, page: Labeller, width: int) -> None:
    page.begin(desk(site).url, width, 800)
    page.says("name", "a.jpg")
    page.press("o")
    page.saved()
    out = page.run(
        """
        return [...document.querySelectorAll("button, input, fieldset, p")].filter((e) => {
          const box = e.getBoundingClientRect();
          const card = (e.closest(".card") ?? document.documentElement).getBoundingClientRect();
          return e.offsetParent && !e.closest(".stage, .hidden, .skip")
            && (box.right > card.right + 1 || box.left < card.left - 1);
        }).map((e) => e.id || e.textContent);
        """
    )
    assert out == []
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")


def test_every_control_is_reached_by_the_keyboard_and_has_a_name(
    site: Path, desk: Desk, page: Labeller
) -> None:
    from selenium.webdriver.common.keys import Keys

    page.begin(desk(site).url)
    page.says("name", "a.jpg")
    page.press("o", "3")
    page.saved()
    page.run("document.body.focus()")
    reached = set()
    for _ in range(40):
        page.press(Keys.TAB)
        reached.add(page.run("const e = document.activeElement; return e.id || e.dataset.key"))
        time.sleep(0.01)
    assert {"theme", "goto", "previous", "take", "next", "undo", "unmarked", "unmark"} <= reached
    assert {"o", "h", "c", "n", "w", "b", "q", "1", "2", "3", "left", "right"} <= reached
    unnamed = page.run(
        """
        return [...document.querySelectorAll("button, input")].filter((e) =>
          e.offsetParent && !e.labels?.length && !e.ariaLabel && !e.textContent.trim()
        ).map((e) => e.outerHTML);
        """
    )
    assert unnamed == []


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("marked", [False, True])
def test_text_stands_out_from_its_ground(
    site: Path, desk: Desk, page: Labeller, theme: str, marked: bool
) -> None:
    page.begin(desk(site).url)
    page.says("name", "a.jpg")
    if marked:
        page.press("h")
        page.saved()
    weakest = page.weakest_contrast(theme)
    assert weakest[0] >= 4.5, weakest
