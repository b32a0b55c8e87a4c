"""What programs get from the server of `3ds label`, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from doorway3ds.images.codec import read_image
from doorway3ds.lab.datasets import samples as datasets
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.truth import picture_truth
from tests.factories import encode, scene
from tests.web.conftest import ask_made_up
from tests.web.label.conftest import Desk


def opening(left: float, right: float, **more: object) -> dict[str, object]:
    return {"left_px": left, "right_px": right, **more}


def test_a_picture_comes_with_its_size_and_the_networks_guess(site: Path, desk: Desk) -> None:
    client = desk(site).client
    folder = client.get("/v1/folder").json()
    assert (folder["name"], folder["pictures"], folder["marked"]) == ("site", 5, 0)
    assert folder["guesses"] is True
    # on its side in the file, upright for the page
    found = client.get("/v1/pictures/4").json()
    assert (found["name"], found["width"], found["height"]) == ("hall/d.jpg", 180, 240)
    assert found["marks"] is None
    (guess,) = found["guess"]["openings"]
    # strips of the tiny network's own picture: a sixteenth of the width each
    assert guess["left_px"] == pytest.approx(0.25 * 180 - 0.5, abs=180 / 32)
    assert guess["right_px"] == pytest.approx(0.5 * 180 - 0.5, abs=180 / 32)
    assert found["p_open"] == pytest.approx(0.953, abs=0.001)
    answer = client.get(found["image"])
    assert answer.headers["cache-control"].startswith("private, max-age")
    shown = read_image(answer.content).image
    assert shown.shape == (240, 180, 3)
    # red at the top left of the file is at the top right of the upright picture
    assert np.argmax(shown[30, 150]) == 0
    assert shown[30, 150, 0] > 180


def test_marks_are_written_and_read_by_training_and_evaluation(site: Path, desk: Desk) -> None:
    client = desk(site).client
    marks = {
        "openings": [
            opening(-30, 99.96, clear=False, confidence=2),
            opening(200, 5000, half_open=True),
        ]
    }
    answer = client.put("/v1/pictures/0", json={"marks": marks, "revision": "unmarked"})
    assert answer.status_code == 200
    assert answer.json()["marked"] == 1
    for number, marks in ((1, {}), (3, {"closed": True}), (4, {"openings": [opening(45.5, 90)]})):
        body = {"marks": marks, "revision": "unmarked"}
        assert client.put(f"/v1/pictures/{number}", json=body).status_code == 200
    a, b, c, d = read_dataset(site).samples
    assert [(o.left_px, o.right_px, o.clear, o.confidence) for o in a.openings] == [
        (-0.5, 100, False, 2),
        (200, 319.5, None, 3),
    ]
    assert [s.is_open for s in (a, b, c, d)] == [True, False, False, True]
    assert [s.place for s in (c, d)] == ["hall", "hall"]
    frame = datasets.load_frame(d)
    truth = picture_truth(d, frame, None)
    # the same column of the same upright picture: near the middle, so nearly straight ahead
    middle = (frame.camera.cx - (45.5 + 90) / 2) / frame.camera.fx
    assert truth.openings[0].bearing_deg == pytest.approx(np.degrees(np.arctan(middle)))


def test_it_goes_on_after_the_last_marked_picture(site: Path, desk: Desk) -> None:
    client = desk(site).client
    assert client.get("/v1/folder").json()["start"] == 0
    for number in (0, 2):
        client.put(f"/v1/pictures/{number}", json={"marks": {}, "revision": "unmarked"})
    assert client.get("/v1/folder").json()["start"] == 3
    assert client.get("/v1/unmarked?after=0").json() == {"number": 1}
    for number in (3, 4):
        client.put(f"/v1/pictures/{number}", json={"marks": {}, "revision": "unmarked"})
    assert client.get("/v1/folder").json()["start"] == 1
    client.put("/v1/pictures/1", json={"marks": {}, "revision": "unmarked"})
    assert client.get("/v1/unmarked?after=1").json() == {"number": None}
    # taken back again
    revision = client.get("/v1/pictures/2").json()["revision"]
    client.put("/v1/pictures/2", json={"marks": None, "revision": revision})
    assert client.get("/v1/unmarked?after=1").json() == {"number": 2}


def test_two_people_do_not_overwrite_each_other(site: Path, desk: Desk) -> None:
    first, second = desk(site).client, desk(site).client
    seen = first.get("/v1/pictures/0").json()["revision"]
    other = {"marks": {"closed": True}, "revision": seen}
    assert second.put("/v1/pictures/0", json=other).status_code == 200
    answer = first.put("/v1/pictures/0", json={"marks": {}, "revision": seen})
    assert answer.status_code == 409
    assert answer.json()["error"]["code"] == "marked_meanwhile"
    assert first.get("/v1/pictures/0").json()["marks"]["closed"] is True


@pytest.mark.parametrize(
    "marks",
    [
        {"openings": [opening(20, 10)]},
        {"openings": [opening(400, 500)]},
        {"openings": [{"left_px": 1}]},
        {"openings": [opening(1, 2, confidence=4)]},
        {"openings": [opening(1, 2)], "closed": True},
        {"openings": [opening(k, k + 1) for k in range(21)]},
        {"closed": False, "file": "/etc/passwd"},
    ],
)
def test_marks_that_make_no_sense_are_refused(site: Path, desk: Desk, marks: object) -> None:
    client = desk(site).client
    answer = client.put("/v1/pictures/0", json={"marks": marks, "revision": "unmarked"})
    assert answer.status_code == 422
    assert answer.json()["error"]["code"] == "invalid_field"
    assert not (site / "doorways.csv").exists()


def test_pictures_are_numbers_never_paths(site: Path, desk: Desk) -> None:
    (site.parent / "secret.jpg").write_bytes(encode(scene()))
    client = desk(site).client
    for path, status in (
        ("5", 404),
        ("-1", 422),
        ("a.jpg", 422),
        ("../secret.jpg", 404),
        ("%2e%2e%2fsecret.jpg", 404),
        ("0/../../secret.jpg", 404),
    ):
        for end in ("", "/image.jpg"):
            assert client.get(f"/v1/pictures/{path}{end}").status_code == status, path


def test_others_may_not_enter(site: Path, desk: Desk) -> None:
    served = desk(site, token="correct-horse")
    asks = {"marks": {}, "revision": "unmarked"}
    bare = {"Authorization": ""}
    assert served.client.get("/v1/pictures/0", headers=bare).status_code == 401
    assert served.client.put("/v1/pictures/0", json=asks, headers=bare).status_code == 401
    assert served.client.get("/v1/pictures/0/image.jpg", headers=bare).status_code == 401
    assert served.client.get("/v1/pictures/0").status_code == 200
    open_to_all = desk(site)
    evil = {"Origin": "https://example.com"}
    assert open_to_all.client.put("/v1/pictures/0", json=asks, headers=evil).status_code == 403
    assert open_to_all.client.get("/", headers={"Host": "evil.test"}).status_code == 403
    large = {"marks": {}, "revision": "x" * 70_000}
    assert open_to_all.client.put("/v1/pictures/0", json=large).status_code == 413
    page = open_to_all.client.get("/")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert not (site / "doorways.csv").exists()


def test_a_damaged_picture_is_said_and_passed_over(site: Path, desk: Desk) -> None:
    (site / "b.png").write_bytes(b"no image")
    client = desk(site).client
    found = client.get("/v1/pictures/1").json()
    assert (found["width"], found["image"]) == (None, None)
    assert found["problem"].startswith("b.png is not")
    assert client.get("/v1/unmarked?after=0").json() == {"number": 2}
    answer = client.put("/v1/pictures/1", json={"marks": {}, "revision": "unmarked"})
    assert answer.status_code == 400
    (site / "b.png").write_bytes(encode(scene(200, 100), "PNG"))
    assert client.get("/v1/pictures/1").json()["width"] == 200


def test_a_table_damaged_meanwhile_is_kept(site: Path, desk: Desk) -> None:
    client = desk(site).client
    client.put("/v1/pictures/0", json={"marks": {}, "revision": "unmarked"})
    (site / "doorways.csv").write_text("what,is,this\n")
    answer = client.put("/v1/pictures/1", json={"marks": {}, "revision": "unmarked"})
    assert answer.status_code == 503
    assert "lacks the column image" in answer.json()["error"]["message"]
    assert (site / "doorways.csv").read_text() == "what,is,this\n"


def test_without_guesses(site: Path, desk: Desk) -> None:
    client = desk(site, guesses=False).client
    assert client.get("/v1/folder").json()["guesses"] is False
    found = client.get("/v1/pictures/0").json()
    assert (found["guess"], found["p_open"], found["width"]) == (None, None, 320)


def test_made_up_requests_get_documented_answers(site: Path, desk: Desk) -> None:
    served = desk(site)
    assert ask_made_up(served, each=10) >= 40
    for body in (b"\xff\xfe", b"{", b"[]", b'{"marks": NaN, "revision": ""}'):
        answer = served.client.put("/v1/pictures/0", content=body)
        assert answer.status_code == 422, answer.text
