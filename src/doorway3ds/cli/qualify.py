"""`3ds qualify`: a network for a robot's own site. Needs the extra `train`."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.camera.options import LensOptions
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import apart, report_files, say, write_numbers
from doorway3ds.cli.shared.progress import Progress
from doorway3ds.cli.shared.training import Watch, command_line
from doorway3ds.decide.options import PACKAGED
from doorway3ds.errors import CallError
from doorway3ds.files import write_bytes
from doorway3ds.lab.train.options import SiteOptions, TuneOptions
from doorway3ds.options import MANY, THREADS, setting

if TYPE_CHECKING:
    from doorway3ds.lab.train.site.score import Comparison

_STOPPED = 130


@expand
def qualify(
    folder: Annotated[
        Path,
        typer.Argument(help="Your images: open-door/ and no-door/, or doorways.csv, or both."),
    ],
    camera: LensOptions,
    site: SiteOptions,
    tuning: TuneOptions,
    network: str = setting(
        PACKAGED, "Network to start from: doornet or a site model.", metavar="NAME|FILE"
    ),
    out: Path = setting(Path("site.onnx"), "Site model to write if it is better.", metavar="FILE"),
    report: Path | None = setting(None, "Write report.html and PNGs there.", metavar="DIR"),
    json_file: Path | None = setting(
        None, "Write the numbers as JSON; - for stdout.", metavar="FILE", names=("--json",)
    ),
    with_: list[Path] | None = setting(
        None, "Also learn from this data set; repeatable.", metavar="DATASET", names=("--with",)
    ),
    answers: list[Path] | None = setting(
        None,
        "Compare two networks by stored answers (folders of 3ds batch, or 3ds look --json) "
        "instead of training; give it twice, before and after.",
        metavar="FILE|DIR",
    ),
    hold_out: float = setting(
        0.4, "Share of the images held out to judge the result.", low=0.1, high=0.8
    ),
    repeats: int = setting(2000, "Bootstrap resamples.", low=100, high=MANY),
    licence: str | None = setting(None, "Licence of the images, noted on the card."),
    threads: int | None = setting(None, "CPU threads; default: all.", **THREADS),
) -> None:
    """Measure the network at your site, fine-tune it on your images, and keep it if it is better.

    Example: 3ds qualify images --report site
    """
    if out.suffix != ".onnx":
        raise CallError(f"--out must be the site model's file, such as site.onnx, got {out}")
    if answers and len(answers) != 2:
        raise CallError("--answers compares two networks; give it twice, before and after")
    from doorway3ds.networks.registry import CARDS

    if not answers:
        cards = {f"the card ({end}) of --out": out.with_suffix(end) for end in CARDS}
        written = {"--out": out, **cards, **report_files("--report", report), "--json": json_file}
        apart(written, [site.places])
    else:
        apart({"--json": json_file}, [*answers, site.places])
    from doorway3ds.camera.choice import choose_camera
    from doorway3ds.lab.train.engine import backend as engine
    from doorway3ds.lab.train.engine import outcome
    from doorway3ds.lab.train.engine.training import Run
    from doorway3ds.lab.train.site.qualify import (
        SiteTraining,
        compare_answers,
        network_file,
        part,
        read_site,
    )
    from doorway3ds.lab.train.site.score import judge

    if report is not None:
        outcome.require_plots()
    start = network_file(network)
    chosen = None if camera == LensOptions() else choose_camera(camera)
    count = Progress()
    facts = {"data": str(folder), "network": network, "command": command_line(), "licence": licence}
    with tempfile.TemporaryDirectory(prefix="3ds-qualify-") as scratch:
        run = Run(Path(scratch), watcher=_Brief(tuning.epochs), seen=count, facts=facts)
        try:
            pictures = read_site(
                folder,
                site.choice(tuning.seed),
                places=site.read_places(),
                camera=None if chosen is None else (chosen.fit, chosen.pose),
                seen=run.seen,
            )
            if answers:
                count.clear()
                comparison = compare_answers(pictures, answers[0], answers[1], repeats, tuning.seed)
                verdict = judge(comparison, 0.0)  # depth is not stored
                _print(comparison, {"held_out": comparison, **vars(verdict)}, json_file)
                word = "better" if verdict.better else "not better"
                _tell(f"{word}: {verdict.why}; depth is not compared", json_file)
                return
            parts = part(pictures, hold_out, tuning.seed)
            say(
                f"{len(pictures.samples)} images, {len(set(pictures.groups))} places by "
                f"{pictures.grouping}: learns from {len(parts.learn)}, chooses by "
                f"{len(parts.inner)}, judges by {len(parts.held)}; left out: "
                f"{len(pictures.left_out)}; near-copies across the split: {parts.leaks}"
            )
            engine.start(threads)
            done = SiteTraining(
                folder,
                pictures,
                parts,
                start,
                run,
                tuning,
                replay=with_ or (),
                hold_out=hold_out,
                repeats=repeats,
                tell=say,
            )
            card = done.train()
        except KeyboardInterrupt:
            count.clear()
            say("stopped; nothing was written")
            raise typer.Exit(_STOPPED) from None
        if done.verdict.better:
            write_bytes(out, (run.out / "site.onnx").read_bytes())
            outcome.write_card(out, card)
    if report is not None:
        from doorway3ds.lab.evaluate.report.html import write_report

        say(f"wrote {write_report(done.page(card), report, card)}")
    _print(done.comparison, card, json_file)
    if done.verdict.better:
        _tell(f"better: {done.verdict.why}", json_file)
        _tell(f"wrote {out}; to use it: 3ds look --network {out} photo.jpg", json_file)
    else:
        _tell(f"not better: {done.verdict.why}; no model was written", json_file)


def _print(comparison: Comparison, card: dict[str, Any], json_file: Path | None) -> None:
    """The table, or the card as JSON on standard output or in a file."""
    from rich.console import Console

    from doorway3ds.cli.shared.output import print_tables
    from doorway3ds.lab.train.site.score import table

    if json_file is not None:
        write_numbers(json_file, card)
    if str(json_file) != "-":
        print_tables(Console(), [table(comparison)])


def _tell(line: str, json_file: Path | None) -> None:
    (say if str(json_file) == "-" else typer.echo)(line)


class _Brief(Watch):
    """The sum of the losses alone."""

    def batch(self, epoch: int, step: int, steps: int, losses: dict[str, float]) -> None:
        super().batch(epoch, step, steps, {"loss": losses["loss"]})

    def epoch(self, row: dict[str, float]) -> None:
        super().epoch({name: row[name] for name in ("epoch", "loss", "val_loss")})
