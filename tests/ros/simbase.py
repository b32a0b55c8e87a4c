"""A base with a camera in a simulated home: python -m tests.ros.simbase SEED

Turns as cmd_vel says, publishes its odometry, image and camera_info. Each line of standard output
says where it stands and where the doorway truly is, in degrees.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image

from doorway3ds.lab.sim.robot.body import MODELS, Body
from doorway3ds.lab.sim.robot.world import Studio, stage_of
from doorway3ds.ros import messages
from doorway3ds.ros.messages import ros_message as make

SIZE = (320, 240)
_LAG_S = 0.15  # of the base's motors


def main(seed: int) -> None:
    rclpy.init()
    node = rclpy.create_node("simbase")
    with Studio(SIZE) as studio:
        stage = stage_of(studio, "doorway", seed)
        camera = Body(model=MODELS["nao"]).camera(*SIZE)
        eye, speed, wanted, slip = stage.eye, 0.0, 0.0, np.random.default_rng(seed)
        lock = threading.Lock()

        def hear(message: Twist) -> None:
            nonlocal wanted
            wanted = message.angular.z

        node.create_subscription(Twist, "cmd_vel", hear, 1)
        images = node.create_publisher(Image, "image", qos_profile_sensor_data)
        infos = node.create_publisher(CameraInfo, "camera_info", qos_profile_sensor_data)
        odometry = node.create_publisher(Odometry, "odom", qos_profile_sensor_data)
        turned_rad, last_s = 0.0, time.monotonic()

        def step() -> None:
            nonlocal turned_rad, last_s, speed, eye
            now = time.monotonic()
            dt, last_s = now - last_s, now
            speed += (wanted - speed) * min(1.0, dt / _LAG_S)
            turned_rad += speed * dt
            # The wheels slip by a percent, which odometry does not know.
            true_deg = np.degrees(speed * dt) * (1 + 0.01 * slip.standard_normal())
            with lock:
                eye = replace(eye, heading_deg=eye.heading_deg + true_deg)
            top = messages.header(make, "odom", node.get_clock().now().to_msg())
            pose = make("geometry_msgs/msg/Pose", orientation=messages.heading(make, turned_rad))
            covered = make("geometry_msgs/msg/PoseWithCovariance", pose=pose)
            odometry.publish(make("nav_msgs/msg/Odometry", header=top, pose=covered))

        node.create_timer(0.04, step)
        threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
        while True:
            with lock:
                here = eye
            top = messages.header(make, "lens", node.get_clock().now().to_msg())
            here = replace(here, heading_deg=here.heading_deg % 360)
            shot = studio.shot(stage.home, camera, here, None)
            infos.publish(messages.camera_info(make, top, camera))
            images.publish(messages.image(make, top, shot.rgb))
            _tell(here.heading_deg, shot)
            time.sleep(0.1)


def _tell(heading_deg: float, shot: Any) -> None:
    doors = [opening.bearing_deg for opening in shot.truth.openings]
    pose = vars(shot.eye.pose)
    print(json.dumps({"heading": heading_deg, "doors": doors, "pose": pose}), flush=True)  # noqa: T201


if __name__ == "__main__":
    main(int(sys.argv[1]))
