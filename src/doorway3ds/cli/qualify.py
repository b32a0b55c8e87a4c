"""`3ds qualify`: a network for a robot's own site. Needs the extra `train`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from doorway3ds.camera.options import LensOptions
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.progress import Progress
from doorway3ds.cli.shared.training import Watch, command_line, say
from doorway3ds.errors import CallError
from doorway3ds.lab.train.options import SiteOptions

_STOPPED = 130


@expand
def qualify(
    folder: Annotated[
        Path,
        typer.Argument(help="Your images: open-door/ and no-door/, or doorways.csv, or both."),
    ],
    camera: LensOptions,
    site: SiteOptions,
    network: Annotated[
        str,
        typer.Option(metavar="NAME|FILE", help="Network to start from: doornet or a site model."),
    ] = "doornet",
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="Site model to write if it is better.")
    ] = Path("site.onnx"),
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write report.html and PNGs there.")
    ] = None,
    json_file: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", help="Write the numbers as JSON; - for stdout."),
    ] = None,
    with_: Annotated[
        list[Path] | None,
        typer.Option(
            "--with", metavar="DATASET", help="Also learn from this data set; repeatable."
        ),
    ] = None,
    hold_out: Annotated[
        float,
        typer.Option(min=0.1, max=0.8, help="Share of the images held out to judge the result."),
    ] = 0.4,
    epochs: Annotated[
        int, typer.Option(min=1, help="Largest number of epochs of each of the two stages.")
    ] = 12,
    learning_rate: Annotated[
        float, typer.Option(help="Learning rate of the heads; the decoder's is a third.")
    ] = (3e-4),
    batch: Annotated[int, typer.Option(min=1, help="Images per step.")] = 8,
    repeats: Annotated[int, typer.Option(min=100, help="Bootstrap resamples.")] = 2000,
    seed: int = 0,
    licence: Annotated[
        str | None, typer.Option(help="Licence of the images, noted on the card.")
    ] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="CPU threads; default: all.")] = None,
) -> None:
    """Measure the network at your site, fine-tune it on your images, keep it if it is better.

    Example: 3ds qualify pictures --report site
    """
    if out.suffix != ".onnx":
        raise CallError(f"--out is the site model's file, such as site.onnx, got {out}")
    if not learning_rate > 0:
        raise CallError(f"--learning-rate must be above 0, got {learning_rate:g}")
    from doorway3ds.camera.choice import choose_camera
    from doorway3ds.lab.train.engine import backend as engine
    from doorway3ds.lab.train.engine import outcome
    from doorway3ds.lab.train.site.fit import TuneOptions
    from doorway3ds.lab.train.site.qualify import network_file, part, read_site, write_model
    from doorway3ds.lab.train.site.qualify import qualify as run

    if report is not None:
        outcome.require_plots()
    start = network_file(network)
    chosen = None if camera == LensOptions() else choose_camera(camera)
    count = Progress()
    try:
        pictures = read_site(
            folder,
            site.choice(seed),
            places=site.read_places(),
            camera=None if chosen is None else (chosen.fit, chosen.pose),
            seen=count,
        )
        parts = part(pictures, hold_out, seed)
        say(
            f"{len(pictures.samples)} pictures, {len(set(pictures.groups))} places by "
            f"{pictures.grouping}: learns from {len(parts.learn)}, chooses by "
            f"{len(parts.inner)}, judges by {len(parts.held)}; left out: "
            f"{len(pictures.left_out)}; near-copies across the split: {parts.leaks}"
        )
        engine.start(threads)
        done = run(
            folder,
            parts,
            pictures,
            start,
            replay=with_ or (),
            options=TuneOptions(epochs, learning_rate, batch, seed=seed),
            hold_out=hold_out,
            repeats=repeats,
            watcher=_Brief(epochs),
            tell=say,
            facts={
                "data": str(folder),
                "network": network,
                "command": command_line(),
                "licence": licence,
            },
        )
    except KeyboardInterrupt:
        count.clear()
        say("stopped; nothing was written")
        raise typer.Exit(_STOPPED) from None
    if done.model is not None:
        write_model(done, out)
    if report is not None:
        from doorway3ds.lab.train.site import report as qualifyreport

        say(f"wrote {qualifyreport.write(done, report)}")
    to_stdout = json_file is not None and str(json_file) == "-"
    if json_file is not None:
        _write_json(outcome.plain(done.card), None if to_stdout else json_file)
    if not to_stdout:
        from rich.console import Console

        from doorway3ds.cli.shared.tables import print_tables
        from doorway3ds.lab.train.site.score import table

        print_tables(Console(), [table(done.comparison)])
    tell = say if to_stdout else typer.echo
    if done.model is None:
        tell(f"not better: {done.verdict.why}; no model was written")
    else:
        tell(f"better: {done.verdict.why}")
        tell(f"wrote {out}; to use it: 3ds look --network {out} photo.jpg")


class _Brief(Watch):
    """The sum of the losses alone."""

    def batch(self, epoch: int, step: int, steps: int, losses: dict[str, float]) -> None:
        super().batch(epoch, step, steps, {"loss": losses["loss"]})

    def epoch(self, row: dict[str, float]) -> None:
        super().epoch({name: row[name] for name in ("epoch", "loss", "val_loss")})


def _write_json(card: dict[str, object], path: Path | None) -> None:
    import json

    from doorway3ds.lab.evaluate.report.html import write_json

    if path is None:
        sys.stdout.write(json.dumps(card, allow_nan=False) + "\n")
    else:
        write_json(path, card)
