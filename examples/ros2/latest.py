"""What the ROS 2 node does, without ROS: pairs messages, and completes the latest pair alone.

A camera sends 30 frames a second and a CPU completes a few. Old frames are worth nothing on a
robot, so what arrives while one is completed replaces what waits: what is completed next is never
older than the completion before it took.
"""

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from steered_marigold import DepthCompleter, DepthCompletion, make_frame
from steered_marigold.core.registration import register_depth
from steered_marigold.errors import InputError
from steered_marigold.io.bags.image_messages import decode_depth, decode_image

Answer = Callable[[Any, DepthCompletion], None]


class LatestFrameCompleter:
    """Takes sensor_msgs/Image messages, of rclpy or of a recording, and gives completions.

    answer: gets the depth message and its completion, in the worker's thread. slop: stamps of a
    pair differ by no more [s]. refuse: gets what is wrong with a message that cannot be used.
    """

    def __init__(
        self,
        completer: DepthCompleter,
        answer: Answer,
        *,
        slop: float = 0.02,
        refuse: Callable[[str], None] = print,
    ) -> None:
        self._completer, self._answer, self._refuse = completer, answer, refuse
        self._slop = slop
        self._image: Any = None
        self._waiting: tuple[Any, Any] | None = None
        self._changed = threading.Condition()
        self._stopped = False
        self.completed = self.replaced = 0
        self._worker = threading.Thread(target=self._work, daemon=True)
        self._worker.start()

    def on_image(self, message: Any) -> None:
        """The latest colour."""
        self._image = message

    def on_depth(self, message: Any) -> None:
        """The latest depth; it waits with the latest colour, in the place of what waited."""
        image = self._image
        if image is None or abs(stamp_s(image) - stamp_s(message)) > self._slop:
            return
        with self._changed:
            self.replaced += self._waiting is not None
            self._waiting = image, message
            self._changed.notify()

    def stop(self) -> None:
        """Ends the worker once it has completed what it is at, and what waits."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._worker.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._stopped)
                pair, self._waiting = self._waiting, None
            if pair is None:
                return
            image, depth = pair
            try:
                completion = self._complete(image, depth)
            except InputError as error:  # one bad message must not end a node
                self._refuse(str(error))
                continue
            self.completed += 1
            self._answer(depth, completion)

    def _complete(self, image: Any, depth: Any) -> DepthCompletion:
        pixels = decode_image(as_recorded(image), "image")
        measured = decode_depth(as_recorded(depth), "depth")
        values, valid_mask = measured.depth, measured.valid_mask
        size = pixels.shape[0], pixels.shape[1]
        if values.shape != size:
            moved = register_depth(values, valid_mask, size)
            values, valid_mask = moved.depth, moved.valid_mask
        return self._completer.answer(make_frame(pixels, values, valid_mask))


def as_recorded(message: Any) -> Any:
    """An Image message of rclpy with the two things that recorded ones have: a type, and bytes."""
    names = ("header", "height", "width", "encoding", "is_bigendian", "step")
    fields = {name: getattr(message, name) for name in names}
    data = np.frombuffer(message.data, np.uint8)
    return SimpleNamespace(**fields, data=data, __msgtype__="sensor_msgs/msg/Image")


def stamp_s(message: Any) -> float:
    """When a message was taken [s]."""
    stamp = message.header.stamp
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def depth_bytes(completion: DepthCompletion) -> bytes:
    """Depth [m] as the data of a 32FC1 image."""
    return completion.depth[0].to("cpu", torch.float32).contiguous().numpy().tobytes()
