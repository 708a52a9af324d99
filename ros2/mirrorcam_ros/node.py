"""The node: parameters in, topics out. Decoding runs in its own thread, so that ROS callbacks are never delayed."""

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
"""Reliable publishers also serve subscribers that request less, such as the quality of service of sensor data."""
WARNING_PERIOD_S = 10.0


def class_of(message_type: str) -> Any:
    """The class of a type such as `sensor_msgs/msg/Image`."""
    package, _, name = message_type.split("/")
    return getattr(import_module(f"{package}.msg"), name)


class LightFieldNode:
    """Publishes the light field of one camera; raises InputError if its parameters do not allow that.

    `node` is the rclpy node with its parameters and topics.
    """

    def __init__(self) -> None:
        self.node = Node("light_field")
        # Text or number: 0 in a parameter file is a number.
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
        self._outputs = {message.topic: self._publisher(message) for message in (*latched, *frames)}
        self._publish(latched)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="light field", daemon=True)
        self._thread.start()

    def _parameter(self, name: str, default: Any, descriptor: Any = None) -> Any:
        return self.node.declare_parameter(name, default, descriptor or ParameterDescriptor()).value

    def _publisher(self, published: Published) -> Any:
        quality = LATCHED if published.latched else FRAMES
        return self.node.create_publisher(class_of(published.message.type), published.topic, quality)

    def _publish(self, messages: list[Published]) -> None:
        for published in messages:
            self._outputs[published.topic].publish(ros_message(published.message, class_of))

    def _wants_depth(self) -> bool:
        return any(self._outputs[topic].get_subscription_count() for topic in DEPTH_TOPICS)

    def _run(self) -> None:
        """Publish frames until the node or the recording ends, or the camera cannot be used."""
        reported = 0
        try:
            for messages in self._stream.frames(self._wants_depth):
                if self._closing.is_set():
                    return
                if isinstance(messages, Lost):
                    self.node.get_logger().warning(f"frame {messages.number} {messages.reason}")
                    continue
                self._publish(messages)
                if self._stream.dropped > reported:
                    reported = self._stream.dropped
                    self.node.get_logger().warning(
                        f"{reported} frames left out, which came too fast to decode",
                        throttle_duration_sec=WARNING_PERIOD_S,
                    )
            self.node.get_logger().info("the recording has ended")
        except InputError as error:
            self.node.get_logger().fatal(str(error))
        rclpy.try_shutdown()

    def close(self) -> None:
        """Stop decoding, and end the node."""
        self._closing.set()
        self._stream.stop()
        self._thread.join(timeout=5.0)
        self.node.destroy_node()


def main(arguments: list[str] | None = None) -> int:
    """Run the node until it is interrupted; return 2 if its parameters are invalid."""
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
