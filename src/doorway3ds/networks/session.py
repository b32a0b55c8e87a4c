"""One ONNX Runtime session: opened with a checked signature, run with checked answers."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError
from doorway3ds.files import digest

PROVIDERS = ("CUDAExecutionProvider", "CoreMLExecutionProvider", "CPUExecutionProvider")
MAX_THREADS = 8  # these networks are small: more threads wait for each other

_NEWER = "; update onnxruntime, or export the file for an older one"
# What to do about what ONNX Runtime says; only the first accuses the file itself.
_HINTS = (
    ("Protobuf parsing failed|No graph was found", "; it is damaged or not an ONNX file"),
    ("IR version|opset", _NEWER),
    ("not a registered|No Op registered", "; it has operators that this ONNX Runtime lacks"),
    ("External data|external", "; put its data file beside it"),
)

Shape = tuple[int | None, ...]
"""Sizes by axis; None: the file must leave this size open."""


def available_threads() -> int:
    """CPUs that this process may use, at most MAX_THREADS."""
    affinity = getattr(os, "sched_getaffinity", None)
    count = len(affinity(0)) if affinity else os.cpu_count() or 1
    return min(count, MAX_THREADS)


def available_providers() -> list[str]:
    """What this build of ONNX Runtime can run on, the fastest first."""
    import onnxruntime as ort

    present = set(ort.get_available_providers())
    return [name for name in PROVIDERS if name in present]


class Session:
    """An ONNX file that takes one float32 image and gives named float32 arrays.

    path: the ONNX file.
    shapes: layouts allowed for the input "image"; a file may leave a fixed size open, too.
    outputs: names that the file must give; optional: those that it may give; no others, but
        where `spare` allows them: they are then not asked for.
    input_name: what the file calls its input.
    sha256: refuse a file whose digest is another.
    threads: per operator; default `available_threads()`.
    providers: default `available_providers()`.

    Raises UserError: no such file, damaged, or of another signature.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        shapes: Sequence[Shape],
        outputs: Sequence[str],
        optional: Sequence[str] = (),
        *,
        input_name: str = "image",
        spare: bool = False,
        sha256: str | None = None,
        threads: int | None = None,
        providers: Sequence[str] | None = None,
    ) -> None:
        self.path = Path(path)
        verify(self.path, sha256)
        self._session = _open(self.path, threads, providers)
        self.outputs = tuple(outputs)
        self._optional = tuple(optional)
        self._input, self._spare = input_name, spare
        self.layout = self._check(shapes)
        self.metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map

    def _check(self, shapes: Sequence[Shape]) -> Shape:
        """The layout among `shapes` that the file has."""
        expected = (
            f'one float32 input "{self._input}" of shape {_or(shapes)} and {_names(self.outputs)}'
        )
        inputs = self._session.get_inputs()
        gives = {output.name: output.type for output in self._session.get_outputs()}
        self.outputs += tuple(name for name in self._optional if name in gives)
        if self._spare:
            gives = {name: kind for name, kind in gives.items() if name in self.outputs}
        if [(i.name, i.type) for i in inputs] == [
            (self._input, "tensor(float)")
        ] and gives == dict.fromkeys(self.outputs, "tensor(float)"):
            shape = tuple(n if isinstance(n, int) else None for n in inputs[0].shape)
            for layout in shapes:
                if _fits(shape, layout):
                    return layout
        found = ", ".join(f'"{i.name}" {i.shape} {i.type}' for i in inputs) or "none"
        raise UserError(
            f"network file {self.path} has another signature: expected {expected}, "
            f"got input {found} and {_names(gives)}"
        )

    @property
    def takes_many(self) -> bool:
        """Whether the file leaves open how many images come at once."""
        return not isinstance(self._session.get_inputs()[0].shape[0], int)

    @property
    def on_cpu(self) -> bool:
        """Whether the session runs on the CPU, whatever was asked for."""
        return bool(self._session.get_providers()[0] == "CPUExecutionProvider")

    def run(self, image: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """The outputs by name for one image of this session's layout.

        Raises UserError if the network fails on it or gives values that are not finite.
        """
        try:
            values = self._session.run(list(self.outputs), {self._input: image})
        except Exception as error:
            raise UserError(f"network file {self.path} failed: {_brief(error)}") from error
        for name, value in zip(self.outputs, values, strict=True):
            if not np.isfinite(value).all():
                raise UserError(
                    f"network file {self.path} returned values that are not finite in {name!r}; "
                    f"it is damaged or badly trained"
                )
        return dict(zip(self.outputs, values, strict=True))

    def misfit(self, name: str, expected: str, got: object) -> UserError:
        """The error for an output of an unusable shape."""
        return UserError(
            f"network file {self.path} has another signature: expected {name!r} {expected}, "
            f"got {got}"
        )


def verify(path: Path, sha256: str | None) -> None:
    """UserError if the file is missing or its digest is not `sha256`."""
    if not path.is_file():
        raise UserError(f"no network file {path}")
    if sha256 is not None and (found := digest(path)) != sha256:
        raise UserError(
            f"network file {path} is damaged: its SHA-256 begins {found[:12]}, "
            f"expected {sha256[:12]}; fetch or make it again"
        )


@dataclass(frozen=True)
class Signature:
    """What an ONNX file says of itself: its inputs' shapes (None: left open), its outputs."""

    inputs: Mapping[str, Shape]
    outputs: tuple[str, ...]


def signature(path: Path) -> Signature:
    """Of any ONNX file; UserError if it is damaged."""
    session = _open(path, 1, ["CPUExecutionProvider"], optimise=False)
    return Signature(
        {
            i.name: tuple(n if isinstance(n, int) else None for n in i.shape)
            for i in session.get_inputs()
        },
        tuple(output.name for output in session.get_outputs()),
    )


def _open(
    path: Path, threads: int | None, providers: Sequence[str] | None, optimise: bool = True
) -> Any:
    import onnxruntime as ort

    options = ort.SessionOptions()
    if not optimise:
        options.graph_optimization_level = ort.GraphOptimizationLevel.ORT_DISABLE_ALL
    options.intra_op_num_threads = threads or available_threads()
    options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    # Threads that spin while they wait take the CPU from whatever else the robot runs.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 4  # what matters arrives as an exception
    try:
        return ort.InferenceSession(
            os.fspath(path), options, providers=list(providers or available_providers())
        )
    # ONNX Runtime's exceptions share no base class of their own.
    except Exception as error:
        said = _brief(error)
        hint = next((h for sign, h in _HINTS if re.search(sign, said)), "")
        raise UserError(
            f"network file {path} cannot be opened by ONNX Runtime {ort.__version__}: {said}{hint}"
        ) from error


def _fits(shape: Shape, layout: Shape) -> bool:
    return len(shape) == len(layout) and all(
        size is None or size == wanted for size, wanted in zip(shape, layout, strict=True)
    )


def _or(shapes: Sequence[Shape]) -> str:
    return " or ".join(
        "(" + ", ".join("any" if size is None else str(size) for size in shape) + ")"
        for shape in shapes
    )


def _names(names: Sequence[str] | Mapping[str, Any]) -> str:
    return f"outputs {', '.join(names)}" if names else "no outputs"


def _brief(error: Exception) -> str:
    """All that ONNX Runtime says, in one line without its code and its own source's positions."""
    line = " ".join(str(error).split()) or type(error).__name__
    line = re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", line)
    line = re.sub(r"^Load model from .*? failed: ?", "", line)
    line = re.sub(r"^/\S+\.(?:cc|h):\d+ .*?\) (?=[A-Z])", "", line)
    return line.rstrip(".")
