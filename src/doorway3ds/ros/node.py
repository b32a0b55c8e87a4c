"""The ROS 2 node `doorway3ds`: an image topic in, decisions out, turns only if it may."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import Any

from doorway3ds.camera.choice import choose_camera
from doorway3ds.camera.model import Pose
from doorway3ds.decide.options import DecideOptions
from doorway3ds.decide.pipeline import build_pipeline
from doorway3ds.draw.space import chosen
from doorway3ds.draw.words import help_page, sentence
from doorway3ds.errors import CallError, UserError
from doorway3ds.live.eyes import Update
from doorway3ds.live.session import Session
from doorway3ds.robots.base import Driver, TurnEnd
from doorway3ds.ros import messages
from doorway3ds.ros.base import BaseRobot, Odometry
from doorway3ds.ros.messages import ros_message as make
from doorway3ds.ros.parameters import BaseOptions, MountOptions, TopicOptions, declare, group
from doorway3ds.ros.received import bare, pose_of, transform_of
from doorway3ds.ros.topic import Outputs, TopicFrame, TopicSource
from doorway3ds.sources.base import View
from doorway3ds.threads import Worker
from doorway3ds.types import Decision, Reason

NAME = "doorway3ds"
_WAIT_S = 0.25


def run(arguments: Sequence[str]) -> None:
    """Runs the node until Ctrl-C; arguments: those of ROS, from --ros-args on.

    Raises CallError for arguments or parameters that are wrong.
    """
    import rclpy
    from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    try:
        # ROS's own handlers would shut the context before the base is told to stop.
        rclpy.init(args=["3ds", *arguments], signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # every distribution raises others
        why = " ".join(str(error).split())
        raise CallError(f"ROS refuses {' '.join(arguments)}: {why}") from error
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        if (rest := rclpy.utilities.remove_ros_args(list(arguments))) != []:
            raise CallError(f"unexpected {' '.join(rest)}; expected --ros-args and what follows it")
        node = rclpy.create_node(NAME)
        stack.callback(node.destroy_node)
        # A turn takes seconds; calls are answered beside the images, by a node of their own.
        calls = rclpy.create_node(
            f"{node.get_name()}_calls", namespace=node.get_namespace(), use_global_arguments=False,
            start_parameter_services=False, enable_rosout=False,
        )  # fmt: skip
        stack.callback(calls.destroy_node)
        doorway = DoorwayNode(node, calls)
        stack.enter_context(_spinning(node, SingleThreadedExecutor()))
        stack.enter_context(_spinning(calls, MultiThreadedExecutor(num_threads=2)))
        stack.callback(doorway.close)  # before anything else: it stops the base
        doorway.decide()


@contextlib.contextmanager
def _spinning(node: Any, executor: Any) -> Iterator[None]:
    """The node's callbacks run in a thread."""
    from rclpy.executors import ExternalShutdownException

    def spin() -> None:
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    executor.add_node(node)
    worker = Worker(spin, node.get_name(), lambda: executor.shutdown(1.0))
    try:
        yield
    finally:
        worker.close()


class DoorwayNode:
    """Topics, services and parameters around one session of live use."""

    def __init__(self, node: Any, calls: Any) -> None:
        self._node = node
        declare(node)
        self._topics = group(node, TopicOptions)
        mount, motion = group(node, MountOptions), group(node, BaseOptions)
        self._move = motion.move
        self._last: Update | None = None
        self._count, self._rated_s = 0, time.monotonic()
        self._lossy = False
        self._turning = threading.Lock()
        self._transforms = transform_buffer(node) if self._topics.use_tf else None

        image_topic, kind = self._image_topic()
        choice = choose_camera(mount)
        self._source = TopicSource(
            image_topic,
            View(choice.fit if choice.given else None),
            clock=lambda: node.get_clock().now().nanoseconds * 1e-9,
            pose=self._pose,
        )
        self._source.notice = node.get_logger().warning
        self._preset = choice.pose
        self._odometry = Odometry()
        self._base = self._make_base(motion)
        pipeline = build_pipeline(group(node, DecideOptions))
        self._outputs = Outputs(node, image_topic, self._topics.robot_frame)
        self._subscribe(image_topic, kind)
        self._serve(calls)
        moves = "it turns when asked" if self._move else "nothing moves (move:=false)"
        node.get_logger().info(f"deciding on {image_topic}; {moves}")
        self._session = Session(self._source, pipeline, heading=self._heading)

    def decide(self) -> None:
        """Decides on every image until `close`, or Ctrl-C in the calling thread."""
        while not self._session.ended:
            try:
                update = self._session.read(_WAIT_S)
            except UserError as error:
                self._source.notice(str(error))
                continue
            if update is not None:
                self._last = update
                self._count += update.fresh
                self._outputs.publish(update)

    def close(self) -> None:
        """Stops the base, as the last thing sent to it, and ends the session."""
        if self._base is not None:
            from rclpy.duration import Duration

            self._base.close()
            self._twists.wait_for_all_acked(Duration(seconds=0.5))
        self._session.close()
        self._source.close()

    def _image_topic(self) -> tuple[str, Any]:
        """The image topic's full name, and its type."""
        from sensor_msgs.msg import CompressedImage, Image

        topic = self._node.resolve_topic_name("image")
        if self._topics.image_transport == "raw":
            return topic, Image
        return topic if topic.endswith("/compressed") else f"{topic}/compressed", CompressedImage

    def _subscribe(self, image_topic: str, kind: Any) -> None:
        from nav_msgs.msg import Odometry as OdometryMessage
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import CameraInfo

        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        for message, topic, take in (
            (kind, image_topic, self._source.offer),
            (CameraInfo, "camera_info", self._source.calibrate),
            (OdometryMessage, "odom", self._odometry.update),
        ):
            self._node.create_subscription(message, topic, take, newest)

    def _serve(self, calls: Any) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import PoseStamped
        from rclpy.callback_groups import ReentrantCallbackGroup
        from std_srvs.srv import Trigger

        node, beside = self._node, ReentrantCallbackGroup()
        for name, act in (("turn", self._turn), ("go", self._go)):
            service = f"{node.get_fully_qualified_name()}/{name}"
            answer = partial(self._answer, act)
            calls.create_service(Trigger, service, answer, callback_group=beside)
        self._goals = node.create_publisher(PoseStamped, "goal_pose", 1) if self._move else None
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        node.create_timer(1.0, self._diagnose)

    def _make_base(self, motion: BaseOptions) -> BaseRobot | None:
        """The base, and the only publisher of cmd_vel; neither is there unless it may move."""
        if not motion.move:
            return None
        from geometry_msgs.msg import Twist, TwistStamped

        kind = TwistStamped if motion.stamped_twist else Twist
        self._twists = self._node.create_publisher(kind, "cmd_vel", 1)

        def send(turn_rad_s: float) -> None:
            top = None
            if motion.stamped_twist:
                stamp = self._node.get_clock().now().to_msg()
                top = messages.header(make, self._topics.robot_frame, stamp)
            self._twists.publish(messages.twist(make, turn_rad_s, top))

        return BaseRobot(self._odometry, send, self._blind)

    def _pose(self, message: Any) -> Pose:
        """By tf2 if it knows the camera's frame, else by the parameters as they are now."""
        if self._transforms is not None:
            measured: Pose | None = self._transforms(self._topics.robot_frame, message.header)
            if measured is not None:
                return measured
        mount = group(self._node, MountOptions)
        placed = {
            name: value
            for name in ("height_m", "pitch_deg", "roll_deg", "yaw_deg", "forward_m", "left_m")
            if (value := getattr(mount, name)) is not None
        }
        return replace(self._preset, **placed)

    def _heading(self) -> float | None:
        where = self._odometry.pose(0.5)
        return None if where is None else where.heading_deg

    def _blind(self) -> str | None:
        """Why the base must not turn now."""
        silent_s = self._source.silent_s()
        if silent_s > group(self._node, BaseOptions).image_timeout_s:
            return f"no image for {silent_s:.1f} s"
        return None

    def _answer(self, act: Callable[[], tuple[bool, str]], request: Any, response: Any) -> Any:
        if not self._turning.acquire(blocking=False):
            response.success, response.message = False, "a turn is under way"
            return response
        try:
            response.success, response.message = act()
        except UserError as error:
            response.success, response.message = False, str(error)
        finally:
            self._turning.release()
        self._node.get_logger().info(response.message)
        return response

    def _turn(self) -> tuple[bool, str]:
        """One turn towards the doorway, if the newest decision is to turn."""
        decision, motion, driver, seen_s = self._ready()
        if decision.reason is not Reason.TURN or decision.turn_deg is None:
            return decision.reason is Reason.ALIGNED, sentence(decision)
        base = self._base
        assert base is not None
        base.speed_rad_s, base.odometry_s = motion.turn_speed, motion.odom_timeout_s
        asked = driver.clamp(decision.turn_deg)
        result = driver.turn(asked, seen_s)
        turned = f"turned {result.turned_deg:+.1f} of {asked:+.1f} deg"
        if result.end is TurnEnd.DONE:
            return True, turned
        return False, f"{turned}: {base.why or result.end}"

    def _go(self) -> tuple[bool, str]:
        """Publishes the doorway as a goal, if the way to it is not known to be blocked."""
        decision, motion, driver, seen_s = self._ready()
        if decision.reason not in (Reason.TURN, Reason.ALIGNED):
            return False, sentence(decision)
        age_s = driver.age_s(seen_s)
        if not 0 <= age_s <= motion.ttl_s:
            return False, f"the decision is {age_s:.2f} s old; it may be at most {motion.ttl_s:g} s"
        door = chosen(decision)
        if door is None:
            return False, "the doorway's distance is not known"
        frame = decision.frame
        assert isinstance(frame, TopicFrame) and self._goals is not None
        top = messages.header(make, self._topics.robot_frame, frame.header.stamp)
        self._goals.publish(messages.doorway_pose(make, top, door))
        x, y = door.middle
        return True, f"goal at {x:.2f} m ahead, {y:.2f} m to the left"

    def _ready(self) -> tuple[Decision, BaseOptions, Driver, float]:
        """What motion needs, and when the doorway was seen last.

        Raises UserError if nothing may move.
        """
        if self._base is None:
            raise UserError("motion is off; start the node with -p move:=true")
        update = self._last
        if update is None or not update.fresh:
            raise UserError(f"no decision to act on: {self._source.problem or 'none was made yet'}")
        frame = update.decision.frame
        if not isinstance(frame, TopicFrame) or not frame.timed:
            raise UserError(f"nothing moves: {self._source.problem or 'the image has no time'}")
        motion = group(self._node, BaseOptions)
        driver = Driver(self._base, move=self._move, limits=motion.limits())
        return update.decision, motion, driver, frame.stamp_s - update.tracked.unseen_s

    def _diagnose(self) -> None:
        now = time.monotonic()
        elapsed_s = max(now - self._rated_s, 1e-3)
        rate, images, infos = (n / elapsed_s for n in (self._count, *self._source.counts()))
        self._count, self._rated_s = 0, now
        update, source = self._last, self._source
        facts: dict[str, object] = {
            "image topic": source.name,
            "decisions per second": round(rate, 1),
            "images per second": round(images, 1),
            "images skipped": source.skipped,
            "images left out": source.damaged,
            "motion": "allowed" if self._move else "off",
        }
        if update is not None:
            raw = update.raw
            facts["camera"] = raw.frame.camera.name
            facts["camera assumed"] = raw.frame.camera.assumed
            facts["reason"] = update.decision.reason
            facts["help"] = help_page(update.decision.reason)
            facts["network ms"] = round(raw.timings_ms.get("network", 0.0), 1)
        if self._session.doubt is not None:
            facts["camera doubt"] = self._session.doubt
        problem = source.problem
        if problem is None and infos >= 5 and images < infos / 2:
            # A camera sends one with each image.
            problem = (
                f"of {infos:.0f} images a second {images:.0f} arrive; if the others are lost, "
                "start the camera with the profile of 3ds ros --dds-profile, or use "
                "image_transport:=compressed"
            )
            if not self._lossy:
                source.notice(problem)
            self._lossy = True
        stamp = self._node.get_clock().now().to_msg()
        top = messages.header(make, "", stamp)
        self._diagnostics.publish(messages.diagnostics(make, top, problem, facts))


def transform_buffer(node: Any) -> Any:
    """The camera's pose by tf2: a function of robot frame and image header; None without tf2."""
    try:
        import tf2_ros
    except ImportError:
        node.get_logger().info("tf2 is not installed: the camera's pose is that of the parameters")
        return None
    from rclpy.time import Time

    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer, node)

    def pose(robot_frame: str, header: Any) -> Pose | None:
        for stamp in (Time.from_msg(header.stamp), Time()):  # at the image, else the newest
            try:
                found = buffer.lookup_transform(robot_frame, bare(header.frame_id), stamp)
            except tf2_ros.TransformException:
                continue
            return pose_of(transform_of(found.transform))
        return None

    pose.listener = listener  # type: ignore[attr-defined]  # it lives as long as its buffer
    return pose
