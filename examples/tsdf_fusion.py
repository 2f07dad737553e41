"""Completed depth of a stream with known poses, fused into one mesh by Open3D's TSDF.

`pip install open3d` (about 900 MB, so it is no extra of this package). Depth that is less sure than
5 % is left out: a surface that was made up should not be carved into the mesh.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from steered_marigold import DepthCompleter, Frame

SURE = 0.05


def sure_depth(completer: DepthCompleter, frame: Frame) -> np.ndarray:
    """Completed depth [m], 0 where it is not sure."""
    completion = completer.answer(frame)
    depth = completion.depth[0].cpu()
    if completion.uncertainty is not None:
        depth = torch.where(completion.uncertainty[0].cpu() < SURE * depth, depth, 0.0)
    return depth.numpy()


def fuse(
    completer: DepthCompleter,
    frames: Iterable[tuple[Frame, np.ndarray]],
    output: Path,
    *,
    voxel_m: float = 0.02,
    farthest_m: float = 5.0,
) -> None:
    """Writes a mesh (.ply) of frames and their poses, 4x4, from the camera to the world [m]."""
    import open3d as o3d

    volume: Any = o3d.pipelines.integration.ScalableTSDFVolume(
        voxel_length=voxel_m,
        sdf_trunc=3 * voxel_m,
        color_type=o3d.pipelines.integration.TSDFVolumeColorType.RGB8,
    )
    for frame, pose in frames:
        if frame.K is None:
            raise ValueError(f"frame {frame.id!r} has no K")
        height, width = frame.size
        K = frame.K.double().numpy()
        camera = o3d.camera.PinholeCameraIntrinsic(
            width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2]
        )
        rgbd = o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.geometry.Image(np.ascontiguousarray(frame.image.numpy())),
            o3d.geometry.Image(sure_depth(completer, frame)),
            depth_scale=1.0,
            depth_trunc=farthest_m,
            convert_rgb_to_intensity=False,
        )
        volume.integrate(rgbd, camera, np.linalg.inv(pose))
    o3d.io.write_triangle_mesh(str(output), volume.extract_triangle_mesh())
