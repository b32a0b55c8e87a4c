"""One camera in, one safe turn out: doorway direction for social robots.

>>> import doorway3ds as d3
>>> decide = d3.Pipeline.default()
>>> decision = decide("examples/doorway.jpg")
>>> decision.reason is d3.Reason.TURN
True

Each name is loaded when it is first used, so that importing the package costs little.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # for type checkers alone, without the cost of importing typing
if TYPE_CHECKING:
    from typing import Any

    from doorway3ds.camera.info import read_camera_info
    from doorway3ds.camera.model import Camera, Pose
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.draw import annotate, overlay
    from doorway3ds.errors import UserError
    from doorway3ds.images.arrays import from_bgr
    from doorway3ds.live.session import watch
    from doorway3ds.live.tracker import Tracker
    from doorway3ds.networks.registry import load as load_network
    from doorway3ds.robots.base import Driver, Robot
    from doorway3ds.robots.loop import TurnLoop
    from doorway3ds.sources.uri import open_source
    from doorway3ds.types import Decision, Frame, Opening, Perception, Reason

__version__ = "1.0.0rc1"

__all__ = [
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

_HOME = {
    "Camera": "camera.model",
    "Decision": "types",
    "Driver": "robots.base",
    "Frame": "types",
    "Opening": "types",
    "Perception": "types",
    "Pipeline": "decide.pipeline",
    "Pose": "camera.model",
    "Reason": "types",
    "Robot": "robots.base",
    "Tracker": "live.tracker",
    "TurnLoop": "robots.loop",
    "UserError": "errors",
    "annotate": "draw",
    "from_bgr": "images.arrays",
    "load_network": "networks.registry",
    "open_source": "sources.uri",
    "overlay": "draw",
    "read_camera_info": "camera.info",
    "watch": "live.session",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f"{__name__}.{_HOME[name]}")
    value = getattr(module, "load" if name == "load_network" else name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
