"""The pipeline that the options of several commands describe."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from doorway3ds.cli.shared.camera import require_range
from doorway3ds.errors import CallError, UserError

if TYPE_CHECKING:
    from doorway3ds.decide.pipeline import Pipeline


def build_pipeline(
    method: str,
    network: str,
    width_m: float | None,
    max_unseen_m: float | None,
    threads: int | None,
    mirror: bool = False,
) -> Pipeline:
    """--method, --network, --width-m, --max-unseen-m, --threads and --mirror.

    Raises CallError for wrong ones.
    """
    if method not in ("opening", "paper"):
        raise CallError(f"--method must be opening or paper, got {method!r}")
    require_range("--width-m", width_m, 0.01, 5)
    require_range("--max-unseen-m", max_unseen_m, 0, 100)

    from doorway3ds.decide.gates import Gates
    from doorway3ds.decide.pipeline import NEEDS, Pipeline
    from doorway3ds.networks import load
    from doorway3ds.networks.mirrored import Mirrored

    needs = NEEDS["paper" if method == "paper" else "opening"]
    try:
        loaded = load(network, threads=threads, needs=needs)
        pipeline = Pipeline(
            Mirrored(loaded) if mirror else loaded,
            method="paper" if method == "paper" else "opening",
            gates=Gates(max_unseen_m=max_unseen_m),
        )
    except UserError as error:
        raise CallError(str(error)) from error
    if width_m is not None and pipeline.params is not None:
        clearance = replace(pipeline.params.clearance, width_m=width_m)
        pipeline = replace(pipeline, params=replace(pipeline.params, clearance=clearance))
    return pipeline
