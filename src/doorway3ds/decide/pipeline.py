"""From an image to a decision: one network, one method, the gates."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from doorway3ds.arguments import require, require_image, require_number, shown
from doorway3ds.camera.model import Camera, Pose
from doorway3ds.decide.each import Each
from doorway3ds.decide.follow import follow
from doorway3ds.decide.gates import Gates, decide
from doorway3ds.decide.opening import OpeningParams, select_opening, way_below
from doorway3ds.decide.options import PACKAGED, DecideOptions, Method
from doorway3ds.decide.paper import select_paper
from doorway3ds.decide.scene.metres import in_metres
from doorway3ds.errors import CallError, UserError
from doorway3ds.images.codec import Picture, read_image
from doorway3ds.networks.adapter import OnnxNetwork
from doorway3ds.networks.averaged import Mirrored
from doorway3ds.networks.base import Joined, Network, presets_of, thresholds_of
from doorway3ds.networks.limits import override
from doorway3ds.networks.registry import load
from doorway3ds.sources.base import View, require_view
from doorway3ds.types import Decision, Frame, Perception

NEEDS: Mapping[str, tuple[str, ...]] = {
    Method.OPENING: ("p_open", "columns"),
    Method.PAPER: ("p_open", "depth"),
}


File = str | os.PathLike[str] | bytes
Given = Frame | NDArray[np.uint8] | File
"""An image as a pipeline takes it."""


@dataclass(frozen=True)
class Pipeline:
    """One network, one method and the gates; called with an image it returns a `Decision`.

    >>> decide = Pipeline.default()
    >>> decision = decide("examples/doorway.jpg")
    >>> decision.open
    True

    It holds no state between calls, so several threads may call one pipeline at once; under asyncio
    await `asyncio.to_thread(decide, image)`.

    Args:
        network: what looks at the image (`load_network`).
        method: "opening" or "paper".
        params: limits of the `opening` method; default: those the network was measured with.
        gates: limits of the decision.
        preset: an operating point by its name in the network's file ("cautious", "balanced",
            "eager" in the packaged one) instead: limits, and p_open from which a doorway is open.

    Raises:
        UserError: for an argument of another kind, or if the network does not give what the method
            needs.
    """

    network: Network
    method: str = Method.OPENING
    params: OpeningParams | None = field(default=None, repr=False)
    gates: Gates = field(default_factory=Gates)
    preset: str | None = None

    def __post_init__(self) -> None:
        if self.method not in list(NEEDS):
            raise CallError(f"method must be one of {', '.join(NEEDS)}, got {self.method!r}")
        _require_network("network", self.network)
        kinds = (OpeningParams, type(None))
        require("params", self.params, kinds, "OpeningParams or None")
        require("gates", self.gates, Gates, "Gates")
        require("preset", self.preset, (str, type(None)), "a name or None")
        lacking = [need for need in NEEDS[self.method] if need not in self.network.gives]
        if lacking:
            raise UserError(
                f"method {self.method} needs {', '.join(lacking)}, which network "
                f"{self.network.name} lacks; join one that has them, as in cnn-srin+densedepth"
            )
        if self.preset is not None:
            params, gates = operating_point(self.network, self.preset, self.gates)
            object.__setattr__(self, "params", self.params or params)
            object.__setattr__(self, "gates", gates)
        elif self.params is None:
            limits = override(OpeningParams(), thresholds_of(self.network))
            object.__setattr__(self, "params", limits)

    @classmethod
    def default(cls, *, threads: int | None = None) -> Pipeline:
        """The packaged network and the `opening` method."""
        return cls(load(PACKAGED, threads=threads))

    @classmethod
    def paper(cls, classifier: Network | None = None, depth: Network | None = None) -> Pipeline:
        """The published method on any classifier and depth network; default: the packaged one.

        classifier gives p_open, depth gives depth; one network may be both.
        """
        for name, network in (("classifier", classifier), ("depth", depth)):
            if network is not None:
                _require_network(name, network)
        given = [network for network in (classifier, depth) if network is not None]
        networks = given if len(given) == 2 else [load(PACKAGED), *given]
        return cls(networks[0] if len(networks) == 1 else Joined(networks), method="paper")

    def __call__(
        self,
        image: Given,
        camera: Camera | None = None,
        pose: Pose | None = None,
    ) -> Decision:
        """The decision for one image.

        Args:
            image: a Frame, an array (H, W, 3) uint8 RGB (`from_bgr` for OpenCV's), or an image file
                as a path or its bytes.
            camera: scaled to the image's size; default: the EXIF focal length of a file, else
                60.9 deg over the longer side, marked as assumed.
            pose: where the camera sits; default: level, of unknown height.

        Returns:
            The decision, with the time of each stage in milliseconds.

        Raises:
            UserError: if the image cannot be read, or the camera has another aspect.
        """
        frame, timings = self._opened(image, camera, pose)
        return _timed(self.decide(frame), timings)

    def decide_file(self, source: File, view: View, name: str) -> Decision:
        """The decision for an image file; name: what errors call it."""
        picture, timings = _read(source, name)
        try:
            return _timed(self.decide(view.of_picture(picture)), timings)
        except UserError as error:
            raise UserError(f"{name}: {error}") from error

    def _opened(
        self, image: Given, camera: Camera | None, pose: Pose | None
    ) -> tuple[Frame, dict[str, float]]:
        """The frame of an image as a call takes it, and the milliseconds that decoding it took."""
        if isinstance(image, Frame):
            return image, {}
        require_view(camera, pose)
        view = View(camera, pose)
        if isinstance(image, np.ndarray):
            require_image("image", image)
            return view.of_picture(Picture(image)), {}
        kinds = (str, os.PathLike, bytes)
        require("image", image, kinds, "a Frame, a (H, W, 3) uint8 array, a path or bytes")
        picture, timings = _read(image)
        return view.of_picture(picture), timings

    def each(
        self,
        images: Iterable[Given],
        camera: Camera | None = None,
        pose: Pose | None = None,
        *,
        workers: int = 2,
    ) -> Iterator[Decision]:
        """The decisions for many images, in their order, by a few threads.

        >>> decide = Pipeline.default()
        >>> images = ["examples/doorway.jpg", "examples/no-doorway.jpg"]
        >>> [decision.open for decision in decide.each(images)]
        [True, False]

        Args:
            images: as a call takes them; taken a little ahead of the answers, however many.
            camera: of all of them, as in a call.
            pose: likewise.
            workers: batches at work at a time; a batch is one image on a CPU, where more only wait
                for each other, and more on a GPU if the network's file takes them.

        Returns:
            An iterator of decisions.

        Raises:
            UserError: in its turn, for an image that cannot be read; the iteration can go on.
        """
        require("images", images, Iterable, "a sequence or iterator of images")
        require_view(camera, pose)
        require_number("workers", workers, 1, 1024, whole=True)
        batch = self.network.batch if isinstance(self.network, OnnxNetwork) else 1
        return Each(lambda some: self._several(some, camera, pose), images, workers, batch)

    def _several(
        self, images: Sequence[Given], camera: Camera | None, pose: Pose | None
    ) -> list[Decision | Exception]:
        """For each image its decision or exception; the network sees all of them in one run."""
        answers: dict[int, Decision | Exception] = {}
        opened: list[tuple[int, Frame, dict[str, float]]] = []
        for index, image in enumerate(images):
            try:
                opened.append((index, *self._opened(image, camera, pose)))
            except Exception as error:  # whatever the image's source raises is raised in its turn
                answers[index] = error
        try:
            seen = self._seen([frame for _, frame, _ in opened])
            for (index, frame, spent), perception in zip(opened, seen, strict=True):
                decision = self.conclude(frame, in_metres(perception, frame))
                answers[index] = _timed(decision, spent)
        except UserError as error:
            answers = dict.fromkeys(range(len(images)), error) | answers
        return [answers[index] for index in range(len(images))]

    def _seen(self, frames: Sequence[Frame]) -> list[Perception]:
        pictures = [(frame.image, frame.camera) for frame in frames]
        if pictures and isinstance(self.network, OnnxNetwork):
            return self.network.together(pictures)
        return [self.network(image, camera) for image, camera in pictures]

    def decide(self, frame: Frame, expected_deg: float | None = None) -> Decision:
        """The decision for one frame, with what each stage took in milliseconds.

        expected_deg: stay with the doorway at this bearing, as `stay` does.
        """
        return self.stay(self.conclude(frame, self.perceive(frame)), expected_deg)

    def stay(self, decision: Decision, expected_deg: float | None) -> Decision:
        """The decision about the doorway expected at a bearing; unchanged if it is not in view."""
        require("decision", decision, Decision, "a Decision")
        require_number("expected_deg", expected_deg, optional=True)
        return follow(decision, expected_deg, self.params, self.gates)

    def perceive(self, frame: Frame) -> Perception:
        """The first half of `decide`, the network's: most of the time, outside Python's lock."""
        require("frame", frame, Frame, "a Frame")
        return in_metres(self.network(frame.image, frame.camera), frame)

    def check_way(
        self, frame: Frame, decision: Decision, perception: Perception | None = None
    ) -> bool | None:
        """Whether the way to a decided doorway is free in a frame that looks down along it.

        perception: of that frame, where the network has looked at it already.
        """
        require("decision", decision, Decision, "a Decision")
        found = decision.selection
        if found.bearing_deg is None:
            return None
        perception = perception or self.perceive(frame)
        return way_below(perception, frame, found.bearing_deg, found.range_m, self.params)

    def conclude(self, frame: Frame, perception: Perception) -> Decision:
        """The second half: what follows from what the network saw in the frame."""
        require("frame", frame, Frame, "a Frame")
        require("perception", perception, Perception, "a Perception")
        start = time.perf_counter()
        if self.method == "opening":
            selection = select_opening(perception, frame, self.params)
        else:
            selection = select_paper(perception, frame)
        selected = time.perf_counter()
        decision = decide(perception, selection, frame, self.method, self.gates)
        timings = {
            **perception.timings_ms,
            "selection": (selected - start) * 1e3,
            "decision": (time.perf_counter() - selected) * 1e3,
        }
        return replace(decision, timings_ms=timings)


def _read(source: File, name: str | None = None) -> tuple[Picture, dict[str, float]]:
    """A decoded image file, and the milliseconds that it took."""
    start = time.perf_counter()
    picture = read_image(source, name=name)
    return picture, {"decode": (time.perf_counter() - start) * 1e3}


def _timed(decision: Decision, before: Mapping[str, float]) -> Decision:
    """The decision with what came before it among its timings."""
    return replace(decision, timings_ms={**before, **decision.timings_ms})


def _require_network(name: str, network: Network) -> None:
    if not (callable(network) and hasattr(network, "gives") and hasattr(network, "name")):
        raise CallError(
            f"{name} must be a network, as load_network returns it, got {shown(network)}"
        )


def build_pipeline(options: DecideOptions, network: Network | None = None) -> Pipeline:
    """The pipeline that options describe.

    network: is used instead of opening the one that the options name.

    Raises CallError for a network that is missing, unknown or unfit for the method.
    """
    try:
        if network is None:
            network = load(options.network, threads=options.threads, needs=NEEDS[options.method])
        pipeline = Pipeline(
            Mirrored(network) if options.mirror else network,
            options.method,
            gates=Gates(max_unseen_m=options.max_unseen_m, aligned_deg=options.aligned_deg),
            preset=options.preset,
        )
    except UserError as error:
        raise CallError(str(error)) from error
    if options.width_m is None or pipeline.params is None:
        return pipeline
    clearance = replace(pipeline.params.clearance, width_m=options.width_m)
    return replace(pipeline, params=replace(pipeline.params, clearance=clearance))


def operating_point(
    network: Network, preset: str, gates: Gates | None = None
) -> tuple[OpeningParams, Gates]:
    """Limits and gates of a preset in the network's file; UserError if it has no such preset."""
    known = presets_of(network)
    if preset not in known:
        raise UserError(
            f"network {network.name} has no preset {preset!r}; "
            + (f"it has {', '.join(known)}" if known else "its file names none")
        )
    point = known[preset]
    if not isinstance(point, Mapping):
        raise UserError(f"preset {preset} of network {network.name} is not an object of limits")
    gates = gates or Gates()
    params = override(OpeningParams(), point.get("limits", {}))
    return params, override(gates, {"open_from": point.get("open_from", gates.open_from)})
