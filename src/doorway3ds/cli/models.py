"""`3ds models`: the networks that have a name, and how their files come here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from doorway3ds.cli.shared.options import expand
from doorway3ds.errors import UserError
from doorway3ds.options import setting

Network = Annotated[str, typer.Argument(metavar="NAME", help="Network, as `3ds models` lists it.")]

app = typer.Typer(
    invoke_without_command=True,
    help="List the networks, fetch or import their files.\n\nExample: 3ds models --json",
)


@app.callback()
@expand
def models(
    context: typer.Context,
    as_json: bool = setting(
        False, "Print one JSON object per network, one per line.", names=("--json",)
    ),
) -> None:
    """List the networks: what each gives, whether its file is here, and how to get it."""
    if context.invoked_subcommand is not None:
        return
    from doorway3ds.networks.registry import MODELS

    rows = [_row(name) for name in MODELS]
    for row in rows:
        typer.echo(json.dumps(row) if as_json else _text(row))


@app.command()
@expand
def fetch(
    name: Network,
    url: str | None = setting(None, "Address (http or https) of an ONNX file."),
    sha256: str | None = setting(None, "SHA-256 of the file; required with --url."),
    licence: str | None = setting(None, "Licence, noted on the file's card."),
) -> None:
    """Download a network's file; it is used only if its SHA-256 and signature are right.

    Without --url it comes from where the network is published: a release, or the Hugging Face hub,
    in whose cache (HF_HOME) it stays; with HF_HUB_OFFLINE=1 it must already be there.

    Example: 3ds models fetch depth-anything-v2-small
    """
    from doorway3ds.networks.fetch import fetch as download

    path = download(name, url, sha256, licence, lambda: typer.echo(f"{name}: fetching", err=True))
    typer.echo(f"{name}: installed {path}")


@app.command("import")
@expand
def import_file(
    name: Network,
    file: Annotated[
        Path, typer.Argument(help="ONNX file with the network's signature, or a Keras .h5 file.")
    ],
    licence: str | None = setting(None, "Licence, noted on the file's card."),
) -> None:
    """Install an ONNX file, such as `3ds train` writes, under a network's name.

    For cnn-srin and densedepth the authors' Keras 1 or 2 weights (.h5) are converted, too.

    Example: 3ds models import densedepth nyu.h5
    """
    from doorway3ds.networks.registry import install

    if file.suffix.lower() in (".h5", ".hdf5", ".keras"):
        from doorway3ds.lab.train.paper.convert import import_published

        path, difference = import_published(name, file, licence)
        typer.echo(
            f"{name}: installed {path}, ONNX Runtime and Keras differ by {difference:.1e} "
            f"of the largest output"
        )
        return
    typer.echo(f"{name}: installed {install(name, file, source=str(file), licence=licence)}")


def _row(name: str) -> dict[str, Any]:
    """What is known of one network and its file."""
    from doorway3ds.files import digest
    from doorway3ds.networks.registry import MODELS, read_card

    model = MODELS[name]
    row: dict[str, Any] = {
        "name": name,
        "about": model.about,
        "gives": list(model.gives),
        "input": model.contract,
        "licence": model.licence,
        "file": str(model.path),
        "state": "missing",
        "sha256": None,
        "make": model.make,
    }
    found = model.found()
    if found is None:
        return row
    row["file"] = str(found)
    try:
        card = read_card(found)
        row["sha256"] = digest(found)
    except (UserError, OSError) as error:
        return row | {"state": f"unreadable: {error}"}
    expected = card.sha256 or model.sha256
    row["state"] = "here" if expected in (None, row["sha256"]) else "damaged"
    row["size_mb"] = round(found.stat().st_size / 1e6, 1)
    row["licence"] = card.licence or model.licence
    row["source"] = card.source or (str(model.hub) if model.hub and found != model.path else None)
    return row


def _text(row: dict[str, Any]) -> str:
    """A few lines for people."""
    about = f"{row['about']}: {', '.join(row['gives'])}"
    fits = len(row["name"]) < 12
    lines = [f"{row['name']:<12}{about}"] if fits else [row["name"], about]
    if row["state"] == "here":
        lines.append(f"here, {row['size_mb']} MB, SHA-256 {row['sha256'][:12]}: {row['file']}")
    else:
        lines.append(f"{row['state']}: {row['file']}")
        lines.append(f"to get it: {row['make']}")
    lines.append(f"input {row['input']}; licence {row['licence']}")
    return ("\n" + " " * 12).join(lines)
