"""The camera's motion, found again on a surface that was moved by a known one."""

import cv2
import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from steered_marigold.core.frame import Frame
from steered_marigold.core.warping import warp_by_flow, warp_depth
from steered_marigold.io.odometry import LEAST_SIDE_OF_FLOW, RgbdOdometry, find_warp, image_flow
from tests.conftest import DATA

SEQUENCE = DATA / "sequence"
K = torch.tensor([[262.5, 0, 160], [0, 262.5, 120], [0, 0, 1]])

pytestmark = pytest.mark.skipif(not SEQUENCE.is_dir(), reason="no real sequence on this machine")
needs_opencv_5 = pytest.mark.skipif(not hasattr(cv2, "Odometry"), reason="OpenCV has no odometry")


def _read(i: int) -> tuple[Tensor, Tensor, Tensor]:
    """Image, depth [m] and camera to world of a frame."""
    image = np.array(Image.open(SEQUENCE / "rgb" / f"{i:04}.jpg").convert("RGB"))
    depth = np.asarray(Image.open(SEQUENCE / "depth" / f"{i:04}.png")).astype(np.float32) / 1000
    pose = np.loadtxt(SEQUENCE / "pose" / f"{i:04}.txt")
    return torch.from_numpy(image), torch.from_numpy(depth), torch.from_numpy(pose)


def _relative_error(warped: Tensor, mask: Tensor, depth: Tensor) -> float:
    both = mask & (depth > 0)
    return float(((warped - depth).abs() / depth.clamp(min=0.1))[both].median())


@needs_opencv_5
@pytest.mark.parametrize("start", [0, 40, 80])
def test_odometry_finds_the_motion_of_real_frames(start: int) -> None:
    """Of frames that are 3 apart; the recorded poses are themselves an estimate."""
    (image, depth, pose), (later, later_depth, later_pose) = _read(start), _read(start + 3)
    motion = RgbdOdometry(K).motion(image, depth, later, later_depth)
    assert motion is not None
    truth = torch.linalg.inv(later_pose) @ pose
    assert (motion[:3, 3] - truth[:3, 3]).norm() < 0.025
    turn = motion[:3, :3].double() @ truth[:3, :3].T
    assert torch.arccos((turn.trace() - 1) / 2).rad2deg() < 1.2
    warped = warp_depth(depth, depth > 0, K, motion)
    assert _relative_error(warped.depth, warped.valid_mask, later_depth) < 0.01


@needs_opencv_5
def test_without_depth_there_is_no_motion() -> None:
    image, depth, _ = _read(0)
    assert RgbdOdometry(K).motion(image, torch.zeros_like(depth), image, depth) is None


def test_flow_follows_an_image_that_was_shifted() -> None:
    image, _, _ = _read(0)
    shifted = torch.roll(image, (3, -5), dims=(0, 1))
    flow = image_flow(image, shifted)[20:-20, 20:-20]
    assert (flow - torch.tensor([-5.0, 3.0])).norm(dim=-1).median() < 0.4


def test_flow_moves_depth_to_where_it_is_measured_next() -> None:
    (image, depth, _), (later, later_depth, _) = _read(10), _read(11)
    warped = warp_by_flow(depth, depth > 0, image_flow(image, later))
    assert _relative_error(warped.depth, warped.valid_mask, later_depth) < 0.01


@needs_opencv_5
@pytest.mark.parametrize(
    ("way", "source"),
    [("motion", "pose"), ("odometry", "odometry"), ("no K", "flow"), ("sparse", "flow")],
)
def test_every_way_to_a_warp_moves_depth_to_where_it_is_measured_next(
    way: str, source: str
) -> None:
    """The motion that is given, odometry, and the flow where there is no K or too little depth."""
    frames = []
    for i in (10, 11):
        image, depth, _ = _read(i)
        mask = depth > 0
        if way == "sparse":
            mask = mask & (
                torch.rand(mask.shape, generator=torch.Generator().manual_seed(i)) < 0.05
            )
        depth = torch.where(mask, depth, 0.0)
        known = None if way == "no K" else K
        frames.append(Frame(image=image, sparse_depth=depth, valid_mask=mask, K=known))
    motion = None
    if way == "motion":
        motion = (torch.linalg.inv(_read(11)[2]) @ _read(10)[2]).float()
    found = find_warp(*frames, motion=motion)
    assert found is not None
    assert found.source == source
    _, depth, _ = _read(10)
    warped = found.warp(depth, depth > 0)
    assert _relative_error(warped.depth, warped.valid_mask, _read(11)[1]) < 0.01
    assert find_warp(frames[0], frames[1].crop(slice(0, 100), slice(0, 100))) is None


def test_images_that_are_too_small_for_flow_have_no_warp() -> None:
    frame = Frame(image=_read(0)[0], sparse_depth=_read(0)[1], valid_mask=_read(0)[1] > 0)
    for side, moves in ((LEAST_SIDE_OF_FLOW, True), (LEAST_SIDE_OF_FLOW - 1, False)):
        small = frame.crop(slice(0, side), slice(0, side))
        assert (find_warp(small, small) is not None) == moves
