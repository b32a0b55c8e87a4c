"""How long from an image on a topic to the decision on another?

    python benchmarks/ros_latency.py

Starts `3ds ros` and a camera that publishes 640x480 rgb8 images at 30 Hz, each in a process of its
own, and listens to ~/decision in this one. Latency is from the stamp, taken just before the image
is published, to the decision's arrival here: serialisation, two trips over DDS, the network and
memory between frames. Needs the extra `ros`; ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST keeps it on
this machine.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import threading
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String

from doorway3ds.camera.model import Camera
from doorway3ds.lab.benchmark import machine
from doorway3ds.ros import messages
from doorway3ds.ros.messages import ros_message as make

RESULTS = Path(__file__).parent / "results"
SIZE, HZ = (640, 480), 30.0
WARM_UP = 30  # decisions


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=15.0, help="of listening")
    parser.add_argument("--network", default="doornet")
    parser.add_argument("--image", type=Path, default=Path("examples/doorway.jpg"))
    parser.add_argument("--camera", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, default=RESULTS / "ros_latency.json")
    given = parser.parse_args()
    rclpy.init()
    if given.camera:
        publish(given.image)
        return
    own = [sys.executable, __file__, "--camera", "--image", str(given.image)]
    node = [sys.executable, "-m", "doorway3ds.cli.main", "ros", "--ros-args"]
    node += ["-p", f"network:={given.network}"]
    running = [subprocess.Popen(command) for command in (node, own)]
    try:
        measured = listen(given.seconds)
    finally:
        for process in running:
            process.send_signal(signal.SIGINT)
        for process in running:
            process.wait(10)
    report = {
        **measured,
        "network": given.network,
        "image": [*SIZE, "rgb8"],
        "hz": HZ,
        "machine": machine(os.cpu_count() or 1),
        "load_average": os.getloadavg(),
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "command": " ".join(sys.argv),
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(
        f"median {report['median_ms']:.1f} ms, 95 % within {report['p95_ms']:.1f} ms, "
        f"{report['decisions_per_s']:.1f} decisions/s of {report['images_per_s']:.1f} images/s, "
        f"oldest {report['max_ms']:.1f} ms; {given.out}"
    )


def publish(path: Path) -> None:
    """The camera: one image again and again, until Ctrl-C."""
    import cv2

    read = cv2.imread(str(path))
    image = np.ascontiguousarray(cv2.resize(read, SIZE)[..., ::-1])
    node = rclpy.create_node("camera")
    images = node.create_publisher(Image, "image", qos_profile_sensor_data)
    infos = node.create_publisher(CameraInfo, "camera_info", qos_profile_sensor_data)
    camera = Camera.from_fov(*SIZE, 60.9)
    due = time.monotonic()
    try:
        while True:
            top = messages.header(make, "lens", node.get_clock().now().to_msg())
            images.publish(messages.image(make, top, image))
            infos.publish(messages.camera_info(make, top, camera))
            due = max(due + 1 / HZ, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
    except (KeyboardInterrupt, ExternalShutdownException):
        return


def listen(seconds: float) -> dict[str, Any]:
    """Latencies of the decisions that come in so many seconds, in milliseconds."""
    node = rclpy.create_node("listener")
    heard: list[tuple[float, float]] = []  # arrival and age
    seen: list[float] = []

    def hear(message: String) -> None:
        now = time.time()
        heard.append((now, (now - json.loads(message.data)["stamp_s"]) * 1e3))

    node.create_subscription(String, "/doorway3ds/decision", hear, 10)
    node.create_subscription(
        CameraInfo, "camera_info", lambda _: seen.append(time.time()), qos_profile_sensor_data
    )
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    deadline = time.monotonic() + 60
    while len(heard) < WARM_UP:
        if time.monotonic() > deadline:
            raise SystemExit("no decisions come")
        time.sleep(0.05)
    begun = time.time()
    time.sleep(seconds)
    kept = np.array([age for at, age in list(heard) if at >= begun])
    images = sum(at >= begun for at in list(seen))
    return {
        "median_ms": float(np.median(kept)),
        "p95_ms": float(np.percentile(kept, 95)),
        "max_ms": float(kept.max()),
        "decisions": int(kept.size),
        "decisions_per_s": kept.size / seconds,
        "images_per_s": images / seconds,
        "latencies_ms": [round(float(age), 2) for age in kept],
    }


if __name__ == "__main__":
    main()
