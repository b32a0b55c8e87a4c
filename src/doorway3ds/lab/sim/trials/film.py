"""A short film of one episode: what the robot sees, and what it says about it."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, wrapped_deg
from doorway3ds.files import write_bytes
from doorway3ds.lab.sim.render.renderer import Eye
from doorway3ds.lab.sim.robot.world import Studio, World, stage_of
from doorway3ds.lab.sim.trials.trial import play
from doorway3ds.types import Decision

WIDTH, HEIGHT = 320, 240
HOLD_MS, STEP_MS = 1100, 120
STEP_DEG, MOST_STEPS = 4.0, 2
COLOURS = 56


def film_scene(scene: str, seed: int, network: str | None, path: Path) -> Path:
    """Plays an episode with the `opening` method and writes it as a GIF.

    Decisions are held; between them the robot's turn is seen in a few steps.
    """
    from doorway3ds.draw import overlay

    loaded = None
    if network is not None:
        from doorway3ds.networks import load

        loaded = load(network, threads=1)
    frames: list[NDArray[np.uint8]] = []
    times: list[int] = []
    before: list[Eye] = []
    with Studio((WIDTH, HEIGHT)) as studio:
        stage = stage_of(studio, scene, seed)

        def picture(camera: Camera, eye: Eye) -> NDArray[np.uint8]:
            return studio.shot(stage.home, camera, eye, None).rgb

        def watch(decision: Decision, world: World) -> None:
            camera, eye = world.body.camera(WIDTH, HEIGHT), world.eye()
            if before:
                for between in _between(before[-1], eye):
                    frames.append(picture(camera, between))
                    times.append(STEP_MS)
            before.append(eye)
            if loaded is None:  # true perception decides without a picture
                shown = replace(decision.frame, image=picture(camera, eye))
                decision = replace(decision, frame=shown)
            frames.append(overlay(decision))
            times.append(HOLD_MS)

        play(studio, stage, "opening", loaded, watch=watch)
    return _write(path, frames, times)


def _between(a: Eye, b: Eye) -> list[Eye]:
    turn = wrapped_deg(b.heading_deg - a.heading_deg)
    steps = min(int(abs(turn) / STEP_DEG), MOST_STEPS)
    return [
        Eye(b.x, b.y, a.heading_deg + turn * (k + 1) / (steps + 1), b.pose) for k in range(steps)
    ]


def _write(path: Path, frames: list[NDArray[np.uint8]], times: list[int]) -> Path:
    """One palette for all frames, and no dither: what stands still then costs nothing."""
    from PIL import Image

    some = frames[:: max(1, len(frames) // 8)]
    palette = Image.fromarray(np.concatenate(some)).quantize(COLOURS)
    plain = Image.Dither.NONE
    pages = [Image.fromarray(frame).quantize(palette=palette, dither=plain) for frame in frames]
    buffer = io.BytesIO()
    pages[0].save(
        buffer, format="GIF", save_all=True, append_images=pages[1:], duration=times, loop=0
    )
    write_bytes(path, buffer.getvalue())
    return path
