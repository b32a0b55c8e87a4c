"""Starts the node; `ros2 launch doorway3ds_ros doorway3ds.launch.py --show-args` lists everything.

Example: ros2 launch doorway3ds_ros doorway3ds.launch.py image:=/camera/image_raw rviz:=true
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from doorway3ds.ros.parameters import table

PACKAGE = "doorway3ds_ros"
TOPICS = {
    "image": ("/camera/image_raw", "Image topic; of compressed images without /compressed."),
    "camera_info": ("/camera/camera_info", "Calibration of the image topic."),
    "odom": ("/odom", "Odometry over which a turn is closed."),
    "cmd_vel": ("/cmd_vel", "Where a turn is sent, if move is true."),
    "goal_pose": ("/goal_pose", "Where ~/go sends the doorway, if move is true."),
}


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in TOPICS.items()
    ]
    arguments += [
        DeclareLaunchArgument(
            name, default_value="", description=f"{known.help} ({kind.__name__}; '': {default})"
        )
        for name, (kind, default, known) in table().items()
    ]
    arguments.append(
        DeclareLaunchArgument("rviz", default_value="false", description="Start RViz, too.")
    )
    return LaunchDescription([*arguments, OpaqueFunction(function=nodes)])


def nodes(context):
    """The node with those parameters that were given, and RViz if it is wanted."""
    given = {}
    for name, (kind, _, _) in table().items():
        text = LaunchConfiguration(name).perform(context)
        if text:
            given[name] = text.lower() in ("true", "1", "yes") if kind is bool else kind(text)
    remapped = [(name, LaunchConfiguration(name)) for name in TOPICS]
    started = [
        Node(
            package=PACKAGE, executable="doorway3ds", name="doorway3ds", output="screen",
            parameters=[given], remappings=remapped,
        )
    ]  # fmt: skip
    if LaunchConfiguration("rviz").perform(context).lower() == "true":
        layout = [FindPackageShare(PACKAGE), "/rviz/doorway3ds.rviz"]
        started.append(Node(package="rviz2", executable="rviz2", arguments=["-d", layout]))
    return started
