"""A ROS 2 node: image and registered depth in, dense depth out. A thin shell around `latest`.

    python examples/ros2/node.py --ros-args -r image:=/camera/color/image_raw \
        -r depth:=/camera/aligned_depth_to_color/image_raw -p preset:=fast

Run it in a sourced ROS 2 workspace whose Python has steered-marigold[ros]. It publishes
depth/completed, 32FC1 [m], with the header of the depth that was measured. rclpy was not at hand,
so this file was never run; what it calls is tested with recorded messages.
"""

import sys
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

from steered_marigold import DepthCompletion, SteeredCompleter

sys.path.insert(0, str(Path(__file__).parent))
from latest import LatestFrameCompleter, depth_bytes


class CompletionNode(Node):
    """Subscribes to `image` and `depth`, publishes `depth/completed`."""

    def __init__(self) -> None:
        super().__init__("steered_marigold")
        preset = self.declare_parameter("preset", "fast").value
        checkpoint = self.declare_parameter("checkpoint", "embedded").value
        slop = self.declare_parameter("slop", 0.02).value
        self._publisher = self.create_publisher(Image, "depth/completed", qos_profile_sensor_data)
        self.frames = LatestFrameCompleter(
            SteeredCompleter.from_checkpoint(checkpoint, preset=preset),
            self._publish,
            slop=slop,
            refuse=lambda text: self.get_logger().warning(text, throttle_duration_sec=5.0),
        )
        callbacks = {"image": self.frames.on_image, "depth": self.frames.on_depth}
        for topic, callback in callbacks.items():
            self.create_subscription(Image, topic, callback, qos_profile_sensor_data)

    def _publish(self, measured: Any, completion: DepthCompletion) -> None:
        height, width = completion.depth.shape[1:]
        message = Image(
            header=measured.header, height=height, width=width, encoding="32FC1", step=4 * width
        )
        message.is_bigendian = int(sys.byteorder == "big")
        message.data = depth_bytes(completion)
        self._publisher.publish(message)


def main() -> None:
    """Runs until it is interrupted."""
    rclpy.init()
    node = CompletionNode()
    try:
        rclpy.spin(node)
    finally:
        node.frames.stop()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
