"""The node: parameters in, topics out. Decoding runs in a thread of its own, so that ROS is always served."""

from __future__ import annotations

import sys
import threading
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from mirrorcam import InputError
from mirrorcam.core.video.frames import Lost
from mirrorcam.optics.light_field.io.ros_messages import Published
from mirrorcam_ros.light_field_stream import LightFieldStream, Settings
from mirrorcam_ros.messages import ros_message

DEPTH_TOPICS = ("depth/image_rect", "depth/camera_info", "points")
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FRAMES = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE)
"""Who listens may ask for less: reliable publishers serve subscriptions with sensor data's quality of service, too."""
TOLD_EVERY_S = 10.0


def class_of(message_type: str) -> Any:
    """The class of a type such as `sensor_msgs/msg/Image`."""
    package, _, name = message_type.split("/")
    return getattr(import_module(f"{package}.msg"), name)


class LightFieldNode:
    """Publishes the light field of one camera; raises InputError where its parameters do not allow that.

    `node` is the node of rclpy, which serves its parameters and topics.
    """

    def __init__(self) -> None:
        self.node = Node("light_field")
        # As text or number: 0 in a file of parameters is a number.
        any_type = ParameterDescriptor(dynamic_typing=True)
        settings = Settings(
            layout=Path(self._parameter("layout", "")),
            device=str(self._parameter("device", "0", any_type)),
            depth=self._parameter("depth", True),
            near_mm=self._parameter("near_mm", 0.0),
            far_mm=self._parameter("far_mm", 0.0),
            width_px=self._parameter("width_px", 0),
            reference_depth_mm=self._parameter("reference_depth_mm", 0.0),
        )
        self._stream = LightFieldStream(settings, self.node.get_logger().warning)
        latched, frames = self._stream.latched(), self._stream.topics()
        self._outputs = {each.topic: self._publisher(each) for each in (*latched, *frames)}
        self._publish(latched)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="light field", daemon=True)
        self._thread.start()

    def _parameter(self, name: str, default: Any, descriptor: Any = None) -> Any:
        return self.node.declare_parameter(name, default, descriptor or ParameterDescriptor()).value

    def _publisher(self, published: Published) -> Any:
        quality = LATCHED if published.latched else FRAMES
        return self.node.create_publisher(class_of(published.message.type), published.topic, quality)

    def _publish(self, messages: list[Published]) -> None:
        for each in messages:
            self._outputs[each.topic].publish(ros_message(each.message, class_of))

    def _wants_depth(self) -> bool:
        return any(self._outputs[topic].get_subscription_count() for topic in DEPTH_TOPICS)

    def _run(self) -> None:
        """Publish frames until the node ends, the recording is over or the camera is of no use."""
        told = 0
        try:
            for messages in self._stream.frames(self._wants_depth):
                if self._over.is_set():
                    return
                if isinstance(messages, Lost):
                    self.node.get_logger().warning(f"frame {messages.number} {messages.reason}")
                    continue
                self._publish(messages)
                if self._stream.dropped > told:
                    told = self._stream.dropped
                    self.node.get_logger().warning(
                        f"{told} frames left out, which came too fast to decode",
                        throttle_duration_sec=TOLD_EVERY_S,
                    )
            self.node.get_logger().info("the recording is over")
        except InputError as error:
            self.node.get_logger().fatal(str(error))
        rclpy.try_shutdown()

    def close(self) -> None:
        """Stop decoding, and end the node."""
        self._over.set()
        self._stream.stop()
        self._thread.join(timeout=5.0)
        self.node.destroy_node()


def main(arguments: list[str] | None = None) -> int:
    """Run the node until it is interrupted; 2 where its parameters are of no use."""
    rclpy.init(args=arguments)
    try:
        light_field = LightFieldNode()
    except InputError as error:
        print(f"mirrorcam_ros: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    try:
        rclpy.spin(light_field.node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        light_field.close()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
