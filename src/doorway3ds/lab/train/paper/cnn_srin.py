"""CNN-SRIN: VGG16's features, frozen, pooled, and the paper's head on them.

The paper (section 3.1) says: VGG16 with ImageNet weights, global average pooling, dense 1024 with
ReLU, a logistic unit, Adam with learning rate 0.001. Our choice where it is silent: 224x224, Keras'
VGG16 preprocessing, batches of 32, binary cross-entropy, class 0 = no-door.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError
from doorway3ds.lab.datasets.places import Seen, unseen
from doorway3ds.lab.datasets.samples import Sample, load_frame
from doorway3ds.lab.train.engine import checkpoint
from doorway3ds.lab.train.engine.backend import device_of, start
from doorway3ds.lab.train.onnx import file as onnxfile
from doorway3ds.lab.train.paper.published import Layers, assign, read_layers
from doorway3ds.networks.adapter import squeeze
from doorway3ds.networks.cnn_srin import SIDE

HIDDEN = 1024
FEATURES = 512
MEAN_BGR = (103.939, 116.779, 123.68)  # of ImageNet, as Keras' VGG16 preprocessing takes it away
TOP_BLOCK = "block5"
_STORE_EVERY = 256  # images between two writes of the feature cache


def build_base(weights: str | Path, side: int = SIDE) -> Any:
    """VGG16 without its top: (B, 3, side, side) RGB 0..255 to (B, 512) pooled features.

    weights: "imagenet" by Keras' own download, "none" for random ones, or an HDF5 file.
    Raises UserError where they cannot be had.
    """
    keras = start()
    image = keras.Input((3, side, side), name="image")
    mean = np.array(MEAN_BGR, np.float32).reshape(1, 3, 1, 1)
    centred = keras.ops.flip(image, axis=1) - mean
    vgg = application(keras.applications.VGG16, weights, input_tensor=centred)
    pooled = keras.layers.GlobalAveragePooling2D(name="pool")(vgg.output)
    return keras.Model(image, pooled, name="vgg16_pooled")


def build_head(features: int = FEATURES) -> Any:
    """(B, 512) features to (B, 1) logits of an open doorway."""
    keras = start()
    return keras.Sequential(
        [
            keras.Input((features,)),
            keras.layers.Dense(HIDDEN, activation="relu", name="dense"),
            keras.layers.Dense(1, name="p_open"),
        ],
        name="head",
    )


def join(base: Any, head: Any) -> Any:
    """The whole network, sharing the layers of both: images to logits."""
    keras = start()
    return keras.Model(base.input, head(base.output), name="cnn_srin")


def untrained() -> Any:
    """The whole network with random weights."""
    return join(build_base("none"), build_head())


def export(model: Any, path: Path, metadata: Mapping[str, Any], side: int = SIDE) -> float:
    """Writes the network's file, p_open for its logits; the largest difference to Keras."""
    return onnxfile.export(
        model,
        path,
        [(3, side, side)],
        ["p_open"],
        lambda x: x.sigmoid().reshape(-1),
        metadata,
        scale=255.0,
    )


def application(make: Callable[..., Any], weights: str | Path, **options: Any) -> Any:
    """A network of keras.applications without its top, with the weights asked for."""
    if str(weights) in ("imagenet", "none"):
        try:
            named = None if str(weights) == "none" else "imagenet"
            return make(include_top=False, weights=named, **options)
        except Exception as error:
            if named is None or "URL" not in str(error):
                raise
            raise UserError(
                "ImageNet weights could not be downloaded; give --weights FILE (Keras' notop "
                "HDF5 file), or --weights none to begin with random ones"
            ) from error
    network = make(include_top=False, weights=None, **options)
    assign(network, read_layers(Path(weights)), Path(weights))
    return network


def import_weights(path: Path) -> Any:
    """The whole network with the weights of a Keras 1 or 2 file; UserError where it misfits.

    VGG16's layers are found by name, the head's two dense layers by being all that is left.
    """
    layers = read_layers(path)
    base, head = build_base("none"), build_head()
    names = {layer.name for layer in base.layers}
    rest = [name for name in layers if name not in names]
    if len(rest) != 2:
        raise UserError(
            f"{path} does not fit: expected two dense layers after VGG16's, "
            f"got {len(rest)}{': ' if rest else ''}{', '.join(rest[:4])}"
        )
    whole: Layers = {name: layers[name] for name in layers if name in names}
    assign(base, whole, path)
    assign(head, {"dense": layers[rest[0]], "p_open": layers[rest[1]]}, path)
    return join(base, head)


def losses(output: Any, target: Any) -> dict[str, Any]:
    """Binary cross-entropy and accuracy of (B, 1) logits against (B, 1) targets 0 or 1."""
    import torch

    logits = output.float()
    return {
        "loss": torch.nn.functional.binary_cross_entropy_with_logits(logits, target),
        "accuracy": ((logits >= 0) == (target >= 0.5)).float().mean(),
    }


def picture(sample: Sample, side: int = SIDE) -> NDArray[np.float32]:
    """(3, side, side) RGB 0..255: the whole image squeezed into the square, as at run time."""
    return np.asarray(squeeze(load_frame(sample).image, side, side, channels_last=False)[0])


def augmented(image: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """A copy: mirrored or not, a part of at least 80 % of each side, other light and contrast."""
    side = image.shape[-1]
    part = max(2, round(side * rng.uniform(0.8, 1.0)))
    top, left = rng.integers(0, side - part + 1, 2)
    cut = image[:, top : top + part, left : left + part].transpose(1, 2, 0)
    big = np.asarray(cv2.resize(np.ascontiguousarray(cut), (side, side)), np.float32)
    if rng.random() < 0.5:
        big = big[:, ::-1]
    lit = (big - 127.5) * rng.uniform(0.75, 1.3) + 127.5 + rng.uniform(-25, 25)
    return np.ascontiguousarray(np.clip(lit, 0, 255).transpose(2, 0, 1), np.float32)


@dataclass(frozen=True)
class Wanted:
    """One row of features: an image as it is (copy 0) or an augmented copy of it."""

    sample: Sample
    digest: str
    copy: int = 0


class FeatureCache:
    """Features of the frozen part, computed once per image, copy, seed and weights."""

    def __init__(self, path: Path, base: Any, seed: int) -> None:
        self.path, self.base, self.seed = path, base, seed
        self._weights = weights_digest(base)
        self._rows: dict[str, NDArray[np.float32]] = {}
        if path.is_file():
            try:
                arrays, state = checkpoint.load(path)
            except UserError:  # damaged: computed again
                arrays, state = {}, {}
            if state.get("weights") == self._weights:
                self._rows = dict(zip(state["keys"], arrays["features"], strict=True))

    def features(
        self,
        wanted: Sequence[Wanted],
        batch: int = 16,
        seen: Seen = unseen,
    ) -> NDArray[np.float32]:
        """(N, 512); what is new is stored every few hundred images and at the end."""
        missing = list({self._key(w): w for w in wanted if self._key(w) not in self._rows}.values())
        try:
            unsaved = 0
            for at in range(0, len(missing), batch):
                seen(at, len(missing))
                part = missing[at : at + batch]
                self._rows |= dict(zip(map(self._key, part), self._compute(part), strict=True))
                unsaved += len(part)
                if unsaved >= _STORE_EVERY:
                    self._store()
                    unsaved = 0
        finally:
            if missing:
                seen(len(missing), len(missing))
                self._store()
        return np.stack([self._rows[self._key(w)] for w in wanted])

    def _compute(self, part: Sequence[Wanted]) -> NDArray[np.float32]:
        import torch

        side = self.base.input_shape[-1]
        images = []
        for w in part:
            image = picture(w.sample, side)
            if w.copy:
                seeds = (self.seed, w.copy, int(w.digest[:12], 16))
                image = augmented(image, np.random.default_rng(seeds))
            images.append(image)
        with torch.no_grad():
            tensor = torch.from_numpy(np.stack(images)).to(device_of(self.base))
            found: NDArray[np.float32] = self.base(tensor, training=False).cpu().numpy()
        return found

    def _key(self, w: Wanted) -> str:
        shape = f"{w.sample.crop}{w.sample.size}"
        return f"{w.digest} {shape} {w.copy} {self.seed if w.copy else 0}"

    def _store(self) -> None:
        if not self._rows:
            return
        state = {"weights": self._weights, "keys": list(self._rows)}
        checkpoint.save(self.path, {"features": np.stack(list(self._rows.values()))}, state)


def weights_digest(model: Any) -> str:
    """SHA-256 of a Keras model's input shape and weights."""
    found = hashlib.sha256(str(model.input_shape).encode())
    for weight in model.weights:
        found.update(weight.value.detach().cpu().numpy().tobytes())
    return found.hexdigest()
