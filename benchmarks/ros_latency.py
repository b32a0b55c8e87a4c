"""How long from an image on a topic to the decision on another?

    python benchmarks/ros_latency.py

Starts `3ds ros` and a camera that publishes 640x480 images at 30 Hz, each in a process of its own,
and listens to ~/decision in this one. Latency is from the stamp, taken just before the image is
published, to the decision's arrival here: serialisation, two trips over DDS, the network and
memory between frames. Three cameras in turn: rgb8 images as Fast DDS sends them by default, rgb8
images with the profile of `3ds ros --dds-profile`, and JPEG. Needs the extra `ros`;
ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST keeps it on this machine.
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
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import String

from doorway3ds.camera.model import Camera
from doorway3ds.lab.benchmark import machine
from doorway3ds.ros import messages
from doorway3ds.ros.messages import ros_message as make

RESULTS = Path(__file__).parent / "results"
SIZE, HZ = (640, 480), 30.0
WARM_UP = 30  # decisions
PROFILE = "FASTDDS_DEFAULT_PROFILES_FILE"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=15.0, help="of listening to each camera")
    parser.add_argument("--network", default="doornet")
    parser.add_argument("--image", type=Path, default=Path("examples/doorway.jpg"))
    parser.add_argument("--camera", choices=["raw", "compressed"], help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, default=RESULTS / "ros_latency.json")
    given = parser.parse_args()
    rclpy.init()
    if given.camera:
        publish(given.image, given.camera == "compressed")
        return
    runs = [
        measure(given, "raw", "default"),
        measure(given, "raw", "profile"),
        measure(given, "compressed", "default"),
    ]
    report = {
        "runs": runs,
        "network": given.network,
        "image": [*SIZE],
        "hz": HZ,
        "machine": machine(os.cpu_count() or 1),
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "command": " ".join(sys.argv),
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(report) + "\n", encoding="utf-8")
    for run in runs:
        print(
            f"{run['transport']:>10}, Fast DDS {run['fastdds']:<7}: "
            f"median {run['median_ms']:.1f} ms, 95 % within {run['p95_ms']:.1f} ms, "
            f"oldest {run['max_ms']:.1f} ms; "
            f"{run['decisions_per_s']:.1f} decisions/s of {run['images_per_s']:.1f} images/s"
        )
    print(given.out)


def measure(given: argparse.Namespace, transport: str, fastdds: str) -> dict[str, Any]:
    """One camera before one node, both started for it."""
    node = [sys.executable, "-m", "doorway3ds.cli.main", "ros", "--ros-args"]
    node += ["-p", f"network:={given.network}", "-p", f"image_transport:={transport}"]
    camera = [sys.executable, __file__, "--camera", transport, "--image", str(given.image)]
    profile = (
        {PROFILE: str(files("doorway3ds.ros") / "fastdds.xml")} if fastdds == "profile" else {}
    )
    running = [
        subprocess.Popen(node),
        subprocess.Popen(camera, env={**os.environ, **profile}),
    ]
    try:
        measured = listen(given.seconds)
    finally:
        for process in running:
            process.send_signal(signal.SIGINT)
        for process in running:
            process.wait(10)
    loads = {"load_average": os.getloadavg()[0]}
    return {"transport": transport, "fastdds": fastdds, **loads, **measured}


def publish(path: Path, packed: bool) -> None:
    """The camera: one image again and again, until Ctrl-C."""
    import cv2

    read = cv2.imread(str(path))
    image = np.ascontiguousarray(cv2.resize(read, SIZE)[..., ::-1])
    node = rclpy.create_node("camera")
    top = messages.header(make, "lens", node.get_clock().now().to_msg())
    message = (messages.compressed if packed else messages.image)(make, top, image)
    topic = "image/compressed" if packed else "image"
    images = node.create_publisher(type(message), topic, qos_profile_sensor_data)
    infos = node.create_publisher(CameraInfo, "camera_info", qos_profile_sensor_data)
    camera = Camera.from_fov(*SIZE, 60.9)
    due = time.monotonic()
    try:
        while True:
            message.header.stamp = node.get_clock().now().to_msg()
            images.publish(message)
            infos.publish(messages.camera_info(make, message.header, camera))
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
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    deadline = time.monotonic() + 60
    while len(heard) < WARM_UP:
        if time.monotonic() > deadline:
            raise SystemExit("no decisions come")
        time.sleep(0.05)
    begun = time.time()
    time.sleep(seconds)
    kept = np.array([age for at, age in list(heard) if at >= begun])
    images = sum(at >= begun for at in list(seen))
    executor.shutdown()
    node.destroy_node()
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
