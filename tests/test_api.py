"""The public names: what they are, what they cost, and that their examples run."""

from __future__ import annotations

import doctest
import inspect
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import doorway3ds as d3
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.networks import load
from doorway3ds.networks.doornet import DoorNet
from doorway3ds.networks.registry import MODELS
from tests.factories import doornet, encode, scene

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.jpg"))
NAMES = [
    "Camera",
    "Decision",
    "Driver",
    "Frame",
    "Opening",
    "Perception",
    "Pipeline",
    "Pose",
    "Reason",
    "Robot",
    "Tracker",
    "TurnLoop",
    "UserError",
    "annotate",
    "from_bgr",
    "load_network",
    "open_source",
    "overlay",
    "read_camera_info",
    "watch",
]


def test_the_public_names() -> None:
    assert sorted(d3.__all__) == NAMES
    assert set(NAMES) <= set(dir(d3))
    for name in NAMES:
        assert getattr(d3, name).__module__.startswith("doorway3ds.")
    with pytest.raises(AttributeError, match="no attribute 'Pipelines'"):
        d3.Pipelines  # noqa: B018


def test_the_import_brings_nothing_heavy() -> None:
    code = (
        "import sys, doorway3ds; heavy = {'cv2', 'numpy', 'onnxruntime', 'typer', 'PIL', 'yaml'};"
        "sys.exit(', '.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", NAMES)
def test_every_name_has_an_example_that_runs(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    value = getattr(d3, name)
    module = inspect.getmodule(value)
    found = doctest.DocTestFinder(recurse=True).find(value, name, module=module)
    assert any(test.examples for test in found)
    runner = doctest.DocTestRunner(verbose=False)
    assert sum(runner.run(test).failed for test in found) == 0


def test_the_package_s_own_example_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    ran = doctest.testmod(d3)
    assert (ran.attempted > 0, ran.failed) == (True, 0)


@pytest.mark.parametrize("name", [n for n in NAMES if n[0].islower()])
def test_functions_say_what_they_take_and_return(name: str) -> None:
    function = getattr(d3, name)
    text = inspect.getdoc(function) or ""
    assert "Args:" in text and "Returns:" in text
    for parameter in inspect.signature(function).parameters:
        assert parameter in text.partition("Args:")[2].partition("Returns:")[0]


@pytest.fixture
def decide(tmp_path: Path) -> Pipeline:
    return Pipeline(load(str(doornet(tmp_path / "net.onnx", left=0.2, right=0.4))))


def test_a_decision_prints_as_one_line_and_is_short(decide: Pipeline) -> None:
    decision = decide(scene(160, 120))
    assert str(decision).startswith("open door 0.95 · ")
    assert "\n" not in str(decision)
    assert len(repr(decision)) < 200
    assert len(repr(decision.frame)) < 500
    assert len(repr(decision.perception)) < 300
    assert len(repr(decision.selection)) < 600
    assert len(repr(decide)) < 250


@pytest.mark.parametrize("method", ["opening", "paper"])
@pytest.mark.parametrize("p_open", [3.0, -3.0])
def test_from_dict_undoes_to_dict(tmp_path: Path, method: str, p_open: float) -> None:
    net = doornet(tmp_path / "net.onnx", left=0.2, right=0.4, p_open=p_open)
    answer = Pipeline(load(str(net)), method)(scene(160, 120)).to_dict()
    kept = json.loads(json.dumps(answer))
    assert d3.Decision.from_dict(kept).to_dict() == kept
    assert str(d3.Decision.from_dict(kept)).partition(" · ")[0].endswith(f"{answer['p_open']:.2f}")


def test_each_decides_in_order_and_goes_on_after_an_error(decide: Pipeline) -> None:
    images: list[Any] = [scene(64 + 16 * n, 48 + 12 * n) for n in range(9)]
    images[4] = b"no image"
    images[6] = encode(scene(200, 150))
    taken = []

    def one_by_one() -> Any:
        for image in images:
            taken.append(1)
            yield image

    answers = decide.each(one_by_one(), workers=3)
    widths: list[int | None] = [next(answers).frame.camera.width]
    assert len(taken) <= 7
    while True:
        try:
            widths.append(next(answers).frame.camera.width)
        except d3.UserError:
            widths.append(None)
        except StopIteration:
            break
    assert widths == [64, 80, 96, 112, None, 144, 200, 176, 192]


class Batched(DoorNet):
    """The packaged network as a GPU would run it, here on the CPU."""

    batch = 4  # type: ignore[assignment]


def test_a_batch_is_answered_as_one_by_one() -> None:
    images: list[Any] = [*EXAMPLES, b"no image", scene(120, 160), scene(160, 120), EXAMPLES[0]]
    path = MODELS["doornet"].path
    one, many = DoorNet(path), Batched(path)
    assert one.batch == 1 and one.session.takes_many

    def said(network: DoorNet) -> list[Any]:
        answers, found = Pipeline(network).each(images), []
        for _ in images:
            try:
                found.append(next(answers))
            except d3.UserError as error:
                found.append(str(error))
        return found

    for single, batched in zip(said(one), said(many), strict=True):
        if isinstance(single, str):
            assert batched == single
            continue
        assert (batched.reason, batched.frame.camera) == (single.reason, single.frame.camera)
        assert batched.p_open == pytest.approx(single.p_open, abs=1e-4)
        assert batched.perception.depth_m == pytest.approx(single.perception.depth_m, rel=1e-3)
        if single.turn_deg is not None:
            assert batched.turn_deg == pytest.approx(single.turn_deg, abs=0.01)


def test_images_of_opencv_become_rgb() -> None:
    image = scene(64, 48)
    assert np.array_equal(d3.from_bgr(image[..., ::-1]), image)
    alpha = np.dstack([image[..., ::-1], np.full((48, 64), 9, np.uint8)])
    assert np.array_equal(d3.from_bgr(alpha), image)
    grey = d3.from_bgr(image[..., 0])
    assert grey.shape == (48, 64, 3) and np.array_equal(grey[..., 2], image[..., 0])
