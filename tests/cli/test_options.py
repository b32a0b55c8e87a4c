"""One declaration of options: what one command can be told, the others can, too."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from doorway3ds.cli.shared.robot import pipeline_for
from doorway3ds.decide.options import DecideOptions, Method
from doorway3ds.errors import CallError
from doorway3ds.robots.runlog import read_log
from doorway3ds.sources import Source
from tests import factories
from tests.conftest import Cli

NET = ("--network", "net.onnx")


@pytest.fixture
def ahead(cli: Cli) -> Cli:
    """A command line beside ahead.onnx, which sees a door two degrees to the left."""
    factories.doornet(Path("ahead.onnx"), left=0.3703, right=0.5703)
    return cli


@pytest.mark.parametrize("limit", [(), ("--aligned-deg", "1")])
def test_a_robot_faces_a_doorway_within_what_it_is_told(ahead: Cli, limit: tuple[str, ...]) -> None:
    ran = ahead("run", "photo.jpg", "--network", "ahead.onnx", "--log", "a", *limit)
    assert ran.out.startswith("dry: it would go +2" if limit else "aligned: ")
    look = ahead("look", "photo.jpg", "--json", "--network", "ahead.onnx", *limit)
    assert json.loads(look.out)["reason"] == ("turn" if limit else "aligned")


def test_memory_faces_a_doorway_within_the_same(ahead: Cli) -> None:
    for number in range(8):
        Path(f"{number}.jpg").write_bytes(Path("photo.jpg").read_bytes())
    call = ["live", "[0-9].jpg", "--json", "--network", "ahead.onnx"]
    said = [
        json.loads(ahead(*call, *limit).out.splitlines()[-1])["tracked"]["reason"]
        for limit in ((), ("--aligned-deg", "1"))
    ]
    assert said == ["aligned", "turn"]


@pytest.mark.parametrize("command", ["run", "live"])
@pytest.mark.parametrize("name", ["--log", "--record"])
def test_the_camera_and_the_log_have_the_same_names(cli: Cli, command: str, name: str) -> None:
    ran = cli(
        command, "photo.jpg", *NET, name, "a", "--fov-deg", "70", "--height-m", "0.9",
        "--pitch-deg", "-4", "--roll-deg", "1",
    )  # fmt: skip
    assert ran.status == 0, ran.err
    start, look = read_log(Path("a"))[:2]
    assert start["options"]["network"] == "net.onnx"
    assert look["camera"]["name"] == "fov 70 deg"
    pose = look["pose"]
    assert (pose["height_m"], pose["pitch_deg"], pose["roll_deg"]) == (0.9, -4, 1)


@pytest.mark.parametrize("command", ["run", "live"])
def test_a_mirrored_run_is_replayed_mirrored(cli: Cli, command: str) -> None:
    assert cli(command, "photo.jpg", *NET, "--log", "a", "--mirror").status == 0
    assert read_log(Path("a"))[0]["network"] == "net.onnx, mirrored average"
    assert cli("replay", "a").err == "1 of 1 decisions are the same; reasons: docs/reasons.md\n"


class Truth:
    """A network that a source brings with it."""

    name = "truth"
    gives = frozenset({"p_open", "columns", "depth", "floor"})

    def __call__(self, image: Any, camera: Any) -> Any:
        raise NotImplementedError


def test_truth_decides_by_every_option() -> None:
    source = cast(Source, SimpleNamespace(name="sim://home", truth=Truth()))
    said = DecideOptions("truth", width_m=0.6, max_unseen_m=1.5, aligned_deg=2)
    pipeline = pipeline_for(source, said)
    assert pipeline.params is not None
    assert pipeline.params.clearance.width_m == 0.6
    assert (pipeline.gates.max_unseen_m, pipeline.gates.aligned_deg) == (1.5, 2)
    assert pipeline.network is source.truth
    with pytest.raises(CallError, match="needs a sim"):
        pipeline_for(cast(Source, SimpleNamespace(name="photo.jpg", truth=None)), said)
    with pytest.raises(CallError, match="--mirror"):
        pipeline_for(source, DecideOptions("truth", mirror=True))


def test_options_are_checked_from_python_too() -> None:
    assert DecideOptions(method=cast(Method, "paper")).method is Method.PAPER
    with pytest.raises(CallError, match="method must be opening or paper"):
        DecideOptions(method=cast(Method, "magic"))
    with pytest.raises(CallError, match=r"width_m must be a number from 0\.01 to 5, got 9"):
        DecideOptions(width_m=9)
