"""`ros2 run doorway3ds_ros doorway3ds`: the same as `3ds ros`."""

from __future__ import annotations

import sys

from doorway3ds.cli.main import run

_INTERRUPTED = 130


def main() -> None:
    """Runs the node until Ctrl-C; ends the process with the status of `3ds ros`, 0 for Ctrl-C."""
    try:
        status = run(["ros", *sys.argv[1:]])
    except KeyboardInterrupt:
        status = _INTERRUPTED
    # ros2 launch reports any other status as a crash.
    sys.exit(0 if status == _INTERRUPTED else status)
