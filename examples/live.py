"""A live loop: colour, what the camera measured, what became of it, and the frame rate.

    python -m examples.live realsense|orbbec|oak|openni [FOLDER]

Pictures go into FOLDER (./demo/live). The camera's own library does the capture: pyrealsense2,
pyorbbecsdk, depthai or OpenCV built with OpenNI. Those four sources follow their makers'
documentation; no camera was at hand, so the loop alone is tested, on arrays that were recorded.
"""

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from steered_marigold import DepthCompleter, SteeredCompleter, make_frame
from steered_marigold.errors import NoMeasurementsError
from steered_marigold.io.files import write_figure

# RGB [height, width, 3] uint8, and depth [height, width] [m], 0 where nothing was measured
Capture = tuple[NDArray[np.uint8], NDArray[np.float32]]


@dataclass(frozen=True, kw_only=True)
class LiveFrame:
    """What a viewer gets. completed: [m]. rate: frames a second, over the last ones."""

    image: NDArray[np.uint8]
    measured: NDArray[np.float32]
    completed: NDArray[np.float32]
    rate: float


def run(
    completer: DepthCompleter, captures: Iterable[Capture], show: Callable[[LiveFrame], None]
) -> None:
    """Completes what comes, until nothing comes; a frame without any measurement is passed by."""
    rate, before = 0.0, perf_counter()
    for image, measured in captures:
        try:
            completion = completer.complete(image, measured)
        except NoMeasurementsError:
            continue  # a hand on the lens
        now = perf_counter()
        latest, before = 1 / (now - before), now
        rate = latest if rate == 0 else 0.9 * rate + 0.1 * latest
        completed = completion.depth[0].cpu().numpy()
        show(LiveFrame(image=image, measured=measured, completed=completed, rate=rate))


def realsense() -> Iterator[Capture]:
    """An Intel RealSense camera, its depth aligned to colour."""
    import pyrealsense2 as rs

    pipeline, config = rs.pipeline(), rs.config()
    config.enable_stream(rs.stream.depth, 640, 480, rs.format.z16, 30)
    config.enable_stream(rs.stream.color, 640, 480, rs.format.rgb8, 30)
    unit = pipeline.start(config).get_device().first_depth_sensor().get_depth_scale()
    align = rs.align(rs.stream.color)
    try:
        while True:
            frames = align.process(pipeline.wait_for_frames())
            depth = np.asarray(frames.get_depth_frame().get_data())
            yield np.array(frames.get_color_frame().get_data()), depth * np.float32(unit)
    finally:
        pipeline.stop()


def orbbec() -> Iterator[Capture]:
    """An Orbbec camera, its depth aligned to colour by the software."""
    import pyorbbecsdk as ob

    pipeline, config = ob.Pipeline(), ob.Config()
    for sensor in (ob.OBSensorType.COLOR_SENSOR, ob.OBSensorType.DEPTH_SENSOR):
        profiles = pipeline.get_stream_profile_list(sensor)
        is_colour = sensor == ob.OBSensorType.COLOR_SENSOR
        form = ob.OBFormat.RGB if is_colour else ob.OBFormat.Y16
        config.enable_stream(profiles.get_video_stream_profile(640, 0, form, 30))
    align = ob.AlignFilter(align_to_stream=ob.OBStreamType.COLOR_STREAM)
    pipeline.start(config)
    try:
        while True:
            frames = pipeline.wait_for_frames(1000)
            if frames is None or not frames.get_color_frame() or not frames.get_depth_frame():
                continue
            aligned = align.process(frames).as_frame_set()
            colour, depth = aligned.get_color_frame(), aligned.get_depth_frame()
            image = np.frombuffer(colour.get_data(), np.uint8)
            codes = np.frombuffer(depth.get_data(), np.uint16)
            metres = codes * np.float32(depth.get_depth_scale() / 1000)
            yield (
                image.reshape(colour.get_height(), colour.get_width(), 3),
                metres.reshape(depth.get_height(), depth.get_width()),
            )
    finally:
        pipeline.stop()


def oak() -> Iterator[Capture]:
    """A Luxonis OAK camera (depthai 3), its depth aligned to colour."""
    import depthai as dai

    with dai.Pipeline() as pipeline:
        sockets = dai.CameraBoardSocket
        colour = pipeline.create(dai.node.Camera).build(sockets.CAM_A)
        left = pipeline.create(dai.node.Camera).build(sockets.CAM_B)
        right = pipeline.create(dai.node.Camera).build(sockets.CAM_C)
        stereo = pipeline.create(dai.node.StereoDepth)
        sync = pipeline.create(dai.node.Sync)
        image = colour.requestOutput((640, 400), dai.ImgFrame.Type.RGB888i)
        left.requestOutput((640, 400)).link(stereo.left)
        right.requestOutput((640, 400)).link(stereo.right)
        image.link(stereo.inputAlignTo)
        image.link(sync.inputs["image"])
        stereo.depth.link(sync.inputs["depth"])
        queue = sync.out.createOutputQueue()
        pipeline.start()
        while pipeline.isRunning():
            group = queue.get()
            millimetres = group["depth"].getFrame()
            rgb = group["image"].getCvFrame()[..., ::-1]  # OpenCV's order is BGR
            yield np.ascontiguousarray(rgb), millimetres * np.float32(0.001)


def openni() -> Iterator[Capture]:
    """Kinect, Xtion and other OpenNI cameras, by an OpenCV that was built with OpenNI 2."""
    import cv2

    camera = cv2.VideoCapture(0, cv2.CAP_OPENNI2)
    camera.set(cv2.CAP_PROP_OPENNI_REGISTRATION, 1)
    while camera.grab():
        has_depth, millimetres = camera.retrieve(None, cv2.CAP_OPENNI_DEPTH_MAP)
        has_image, bgr = camera.retrieve(None, cv2.CAP_OPENNI_BGR_IMAGE)
        if has_depth and has_image:
            rgb = np.ascontiguousarray(np.asarray(bgr, np.uint8)[..., ::-1])
            yield rgb, np.asarray(millimetres, np.float32) * np.float32(0.001)
    camera.release()


class PictureWriter:
    """Writes each frame as a picture; where OpenCV has windows, `cv2.imshow` goes here instead."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.count = folder, 0

    def __call__(self, frame: LiveFrame) -> None:
        import torch

        from steered_marigold.pictures.panels import frame_panels

        figure = frame_panels(
            make_frame(frame.image, frame.measured), torch.from_numpy(frame.completed)
        )
        write_figure(self.folder / f"{self.count:06d}.png", figure)
        self.count += 1
        print(f"frame {self.count}, {frame.rate:.1f} frames a second")


CAMERAS = {"realsense": realsense, "orbbec": orbbec, "oak": oak, "openni": openni}

if __name__ == "__main__":
    _, camera, *folder = sys.argv
    writer = PictureWriter(Path(*folder or ("demo", "live")))
    run(SteeredCompleter.from_checkpoint(preset="fast"), CAMERAS[camera](), writer)
