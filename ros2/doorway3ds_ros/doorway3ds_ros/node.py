"""`ros2 run doorway3ds_ros doorway3ds`: the same as `3ds ros`."""

from __future__ import annotations

import sys

from doorway3ds.cli.main import run


def main() -> None:
    """Runs the node until Ctrl-C; ends the process with the status of `3ds ros`."""
    try:
        status = run(["ros", *sys.argv[1:]])
    except KeyboardInterrupt:
        status = 130
    sys.exit(status)
