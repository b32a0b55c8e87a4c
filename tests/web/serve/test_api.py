"""What a real server answers on loopback."""

from __future__ import annotations

import io
import json
import threading
from pathlib import Path

import httpx
import numpy as np
import pytest

from doorway3ds import __version__
from doorway3ds.images.codec import read_image
from tests.conftest import Cli
from tests.factories import encode
from tests.web.conftest import Serve, Served


def test_the_answer_is_that_of_look(shared: Served, cli: Cli, photo: bytes, network: Path) -> None:
    looked = json.loads(cli("look", "photo.jpg", "--json", "--network", network).out)
    posted = shared.client.post("/v1/decide?name=photo.jpg", content=photo)
    assert posted.status_code == 200
    answer = posted.json()
    assert list(answer) == list(looked)
    for volatile in (answer, looked):
        volatile.pop("timings_ms")
    assert answer == looked
    assert answer["reason"] == "turn"
    assert answer["turn_deg"] == pytest.approx(13.2, abs=0.2)


def test_multipart_fields_outrank_the_query(shared: Served, photo: bytes) -> None:
    answer = shared.client.post(
        "/v1/decide?camera=auto&name=query.jpg",
        files={"image": ("hall.jpg", photo, "image/jpeg")},
        data={"camera": "nao-v6-top", "name": "part.jpg"},
    )
    assert answer.status_code == 200
    assert answer.json()["camera"] == {"name": "nao-v6-top", "assumed": False}
    assert answer.json()["image"] == "part.jpg"


def test_a_multipart_file_names_the_image(shared: Served, photo: bytes) -> None:
    answer = shared.client.post("/v1/decide", files={"image": ("../../hall.jpg", photo)})
    assert answer.json()["image"] == "../../hall.jpg"


def test_a_narrower_field_of_view_makes_smaller_angles(shared: Served, photo: bytes) -> None:
    client = shared.client
    wide, narrow = (
        client.post(f"/v1/decide?fov_deg={fov}", content=photo).json()["bearing_deg"]
        for fov in (90, 30)
    )
    assert 0 < narrow < wide / 2.5


def test_limits_of_the_command_line_are_fields_too(
    shared: Served, cli: Cli, photo: bytes, network: Path
) -> None:
    usual = shared.client.post("/v1/decide", content=photo).json()
    faced = shared.client.post("/v1/decide?aligned_deg=20", content=photo).json()
    assert (usual["reason"], faced["reason"], faced["turn_deg"]) == ("turn", "aligned", 0)
    posted = shared.client.post(
        "/v1/decide", files={"image": ("photo.jpg", photo)}, data={"mirror": "true"}
    ).json()
    looked = json.loads(cli("look", "photo.jpg", "--json", "--mirror", "--network", network).out)
    assert posted["network"] != usual["network"]
    for volatile in (posted, looked):
        volatile.pop("timings_ms")
    assert posted == looked


def test_the_paper_method_adds_its_pixels(shared: Served, photo: bytes) -> None:
    answer = shared.client.post("/v1/decide?method=paper", content=photo).json()
    assert answer["method"] == "paper"
    assert len(answer["best_pixel"]) == 2


def test_the_view_holds_what_the_page_draws(shared: Served, photo: bytes) -> None:
    answer = shared.client.post("/v1/decide?view=true", content=photo).json()
    view = answer["view"]
    assert (view["width"], view["height"]) == (160, 120)
    assert view["headline"] == "Turn left 13.2°"
    assert view["openings"][0]["left_px"] == pytest.approx(0.2 * 160 - 0.5)
    assert view["depth"]["png"].startswith("data:image/png;base64,")
    # The tiny network calls the lower half floor.
    points = np.array(view["floor"][0])
    assert points[:, 1].min() == pytest.approx(60, abs=4)
    assert points[:, 0].max() == pytest.approx(159, abs=3)


def test_annotate_gives_a_picture(shared: Served, photo: bytes) -> None:
    answer = shared.client.post("/v1/annotate", content=photo)
    assert answer.headers["content-type"] == "image/jpeg"
    assert read_image(answer.content).image.shape[1] == 1600


@pytest.mark.parametrize(
    ("call", "status", "code"),
    [
        (("POST", "/v1/decide", b""), 400, "no_image"),
        (("POST", "/v1/decide", b"GIF89a"), 400, "bad_image"),
        (("POST", "/v1/decide?method=magic", b"x"), 422, "invalid_field"),
        (("POST", "/v1/decide?fov_deg=nan", b"x"), 422, "invalid_field"),
        (("POST", "/v1/decide?fov_deg=60&camera=auto", b"x"), 422, "invalid_field"),
        (("POST", "/v1/decide?camera=/etc/passwd", b"x"), 422, "invalid_field"),
        (("POST", "/v1/decide?network=/etc/passwd.onnx", None), 422, "unknown_network"),
        (("POST", "/v1/decide?preset=bold", None), 422, "unknown_preset"),
        (("POST", "/v1/decide?aligned_deg=31", b"x"), 422, "invalid_field"),
        (("POST", "/v1/decide?mirror=perhaps", b"x"), 422, "invalid_field"),
        (("POST", "/v1/decide?colour=red", b"x"), 422, "invalid_field"),
        (("GET", "/v1/decide", None), 405, "method_not_allowed"),
        (("GET", "/nowhere", None), 404, "not_found"),
        (("GET", "/static/..%2f..%2frun.py", None), 404, "not_found"),
        (("GET", "/static/%2e%2e/run.py", None), 404, "not_found"),
        (("GET", "/static/main.js%00", None), 404, "not_found"),
        (("GET", "/v1/stream", None), 404, "no_source"),
        (("GET", "/v1/frame.jpg", None), 404, "no_source"),
        (("GET", "/v1/link.svg", None), 404, "no_link"),
    ],
)
def test_errors_are_one_json_object(
    shared: Served, photo: bytes, call: tuple[str, str, bytes | None], status: int, code: str
) -> None:
    method, path, body = call
    content = photo if body is None and method == "POST" else body
    answer = shared.client.request(method, path, content=content)
    assert answer.status_code == status
    error = answer.json()["error"]
    assert (error["status"], error["code"]) == (status, code)
    assert error["message"]
    assert "\n" not in error["message"]


def test_an_image_that_its_decoder_would_make_up_is_refused(shared: Served, photo: bytes) -> None:
    middle = len(photo) // 2
    for path in ("/v1/decide", "/v1/annotate"):
        answer = shared.client.post(path, content=photo[:middle] + photo[middle + 40 :])
        assert (answer.status_code, answer.json()["error"]["code"]) == (400, "bad_image")
        assert "the image is damaged (" in answer.json()["error"]["message"]


def test_json_is_refused_by_its_type(shared: Served) -> None:
    answer = shared.client.post("/v1/decide", json={"image": "x"})
    assert answer.status_code == 415


@pytest.mark.parametrize(
    ("body", "code"),
    [
        (b"--x\r\nnonsense", "no_image"),
        (b"--x\r\nContent-Disposition: form-data\r\n\r\n\r\n--x--", "bad_multipart"),
        (b"--x--\r\n", "no_image"),
    ],
)
def test_damaged_multipart_is_refused(shared: Served, body: bytes, code: str) -> None:
    kind = {"Content-Type": "multipart/form-data; boundary=x"}
    answer = shared.client.post("/v1/decide", content=body, headers=kind)
    assert answer.status_code == 400
    assert answer.json()["error"]["code"] == code


def test_health_info_and_metrics(shared: Served, photo: bytes, network: Path) -> None:
    client = shared.client
    assert client.get("/healthz").json() == {
        "status": "ok",
        "version": __version__,
        "in_flight": 0,
        "source": None,
    }
    info = client.get("/v1/info").json()
    assert info["networks"][0] == {"name": str(network), "methods": ["opening", "paper"]}
    assert "nao-v6-top" in [camera["name"] for camera in info["cameras"]]

    def count(text: str, name: str) -> float:
        lines = [line for line in text.splitlines() if line.startswith(name + " ")]
        return float(lines[0].split()[1]) if lines else 0.0

    before = client.get("/metrics").text
    client.post("/v1/decide", content=photo)
    text = client.get("/metrics").text
    for name in (
        'doorway3ds_requests_total{route="/v1/decide",status="200"}',
        'doorway3ds_decisions_total{origin="request",reason="turn"}',
        'doorway3ds_stage_seconds_count{stage="network"}',
    ):
        assert count(text, name) == count(before, name) + 1
    assert "doorway3ds_in_flight 0" in text


def test_openapi_describes_every_public_route(shared: Served) -> None:
    schema = shared.client.get("/openapi.json").json()
    assert set(schema["paths"]) == {
        "/v1/decide",
        "/v1/annotate",
        "/v1/stream",
        "/v1/frame.jpg",
        "/v1/decision",
        "/v1/source",
        "/v1/calibration",
        "/v1/calibration/finish",
        "/v1/calibration/camera.yaml",
        "/v1/calibration/board.pdf",
        "/v1/info",
        "/healthz",
        "/metrics",
    }
    body = schema["paths"]["/v1/decide"]["post"]["requestBody"]["content"]
    assert set(body) >= {"image/jpeg", "multipart/form-data"}
    assert schema["components"]["schemas"]["DecisionAnswer"]["examples"][0]["reason"] == "turn"


def test_uploads_never_touch_the_disk(
    shared: Served, monkeypatch: pytest.MonkeyPatch, photo: bytes
) -> None:
    def refuse(*_: object, **__: object) -> io.BytesIO:
        raise AssertionError("a file was made for an upload")

    monkeypatch.setattr("tempfile._TemporaryFileWrapper", refuse)
    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    rng = np.random.default_rng(0)
    large = encode(rng.integers(0, 255, (1400, 1400, 3), dtype=np.uint8), "PNG")
    assert len(large) > 2 * 2**20  # twice what Starlette's parser keeps in memory by itself
    answer = shared.client.post("/v1/decide", files={"image": ("noise.png", large)})
    assert answer.status_code == 200


def test_eight_clients_at_once_are_all_answered(shared: Served, photo: bytes) -> None:
    served = shared
    statuses: list[int] = []

    def client() -> None:
        with httpx.Client(base_url=served.url, timeout=30) as own:
            statuses.extend(own.post("/v1/decide", content=photo).status_code for _ in range(5))

    threads = [threading.Thread(target=client) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert statuses == [200] * 40


def test_the_page_loads_nothing_from_elsewhere(shared: Served) -> None:
    client = shared.client
    page = client.get("/")
    assert page.status_code == 200
    for name in ("index.html", "login.html", "app.css", "marks.css", "main.js", "stage.js"):
        answer = client.get(f"/static/{name}")
        assert answer.status_code == 200
        assert "http://" not in answer.text.replace("http://www.w3.org/2000/svg", "")
        assert answer.text.count("https://") == 0
    etag = client.get("/static/app.css").headers["etag"]
    assert client.get("/static/app.css", headers={"If-None-Match": etag}).status_code == 304


def test_a_picture_with_too_many_pixels_is_refused(serve: Serve, photo: bytes) -> None:
    answer = serve(limits={"max_pixels": 160 * 120 - 1}).client.post("/v1/decide", content=photo)
    assert answer.status_code == 400
    assert "too large" in answer.json()["error"]["message"]


def test_the_pages_examples_are_those_of_the_project(shared: Served) -> None:
    folder = Path(__file__).parents[3] / "examples"
    for name in ("doorway", "blocked", "no-doorway"):
        data = shared.client.get(f"/static/example-{name}.jpg").content
        assert data == (folder / f"{name}.jpg").read_bytes()


def test_an_error_of_a_picture_names_its_file(shared: Served) -> None:
    name = "folder/READ\u2028ME\n.md"
    answer = shared.client.post("/v1/decide", params={"name": name}, content=b"# Read me")
    assert answer.status_code == 400
    message = answer.json()["error"]["message"]
    assert message.startswith("READ?ME?.md is not an image; expected one of")
