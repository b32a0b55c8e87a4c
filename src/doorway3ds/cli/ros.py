"""`3ds ros`: the ROS 2 node."""

from __future__ import annotations

import sys
from importlib.resources import files

import typer

from doorway3ds.cli.shared.options import expand
from doorway3ds.options import setting

CONTEXT = {"allow_extra_args": True, "ignore_unknown_options": True}
"""Of the command: what it does not know is ROS's."""


@expand
def ros(
    context: typer.Context,
    ros_args: bool = setting(False, "Begin ROS's own arguments: -r, -p, --params-file, ..."),
    parameters: bool = setting(False, "List the parameters and exit."),
    dds_profile: bool = setting(
        False, "Print the path of a Fast DDS profile for cameras of raw images and exit."
    ),
) -> None:
    """Run the ROS 2 node doorway3ds on an image topic until Ctrl-C.

    Topics and parameters are set as usual in ROS; see docs/ros.md. Nothing moves unless
    -p move:=true is given, and then only if ~/turn or ~/go is called.

    Example: 3ds ros --ros-args -r image:=/cam/image_raw -r camera_info:=/cam/camera_info
    """
    if parameters:
        _list()
        return
    if dds_profile:
        typer.echo(files("doorway3ds.ros") / "fastdds.xml")
        return
    from doorway3ds.cli.shared.robot import ended_by_sigterm
    from doorway3ds.ros.node import run

    with ended_by_sigterm():
        run(["--ros-args", *context.args] if ros_args else context.args)


def _list() -> None:
    from doorway3ds.ros.parameters import table

    for name, (kind, default, known) in table().items():
        shown = "unset" if default is None else default
        bounds = "" if known.low is None else f", {known.low:g} to {known.high:g}"
        sys.stdout.write(f"{name} ({kind.__name__}{bounds}; default {shown}): {known.help}\n")
