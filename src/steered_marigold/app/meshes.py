"""A completed frame as a surface that a browser can turn: binary glTF."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Float, Int, UInt8
from PIL import Image
from torch import Tensor
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from steered_marigold.core.geometry import unproject
from steered_marigold.io.files import atomic_write

_LONGEST_SIDE = 320  # vertices; the picture on them keeps all its pixels
_EDGE = 0.06  # neighbours whose depths differ by a larger share do not touch
BACKGROUND = (40, 46, 56)  # behind the surface; uncertain points fade into it
_FIELD_OF_VIEW = 60.0  # degrees across the image, where nobody tells the camera


def guessed_intrinsics(size: tuple[int, int]) -> Float[Tensor, "3 3"]:
    """K [px] of a common camera for an image of `size` (height, width)."""
    height, width = size
    focal = width / 2 / np.tan(np.radians(_FIELD_OF_VIEW / 2))
    middle = ((width - 1) / 2, (height - 1) / 2)
    return torch.tensor([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]]).float()


def write_mesh(
    path: Path,
    depth: Float[Tensor, "height width"],
    image: UInt8[Tensor, "height width 3"],
    K: Float[Tensor, "3 3"],
    *,
    uncertainty: Float[Tensor, "height width"] | None = None,
    most_uncertain: float | None = None,
) -> float:
    """Writes a .glb, y up, with triangles between neighbours that are no depth edge.

    Returns how far the camera was from the middle of what is shown [m]. most_uncertain: points
    whose uncertainty [m] is larger are left out, and those above half of it fade. Depth [m] of 0 is
    unknown. Raises InputError if `path` cannot be written.
    """
    step = -(-max(depth.shape) // _LONGEST_SIDE)
    shown, picture = depth > 0, image.numpy()
    if uncertainty is not None and most_uncertain is not None:
        shown = shown & (uncertainty <= most_uncertain)
        share = (2 * uncertainty.numpy() / most_uncertain - 1).clip(0, 1)[..., None]
        picture = np.rint(picture * (1 - share) + np.array(BACKGROUND) * share).astype(np.uint8)
    points = unproject(depth, K)[::step, ::step]
    faces = _faces(depth[::step, ::step], shown[::step, ::step])
    height, width = points.shape[:2]
    v, u = np.mgrid[0:height, 0:width]
    uv = np.stack([(u * step + 0.5) / depth.shape[1], 1 - (v * step + 0.5) / depth.shape[0]], -1)
    # a surface that shines by itself looks as the image does, whatever the light
    material = PBRMaterial(  # type: ignore[no-untyped-call]
        emissiveTexture=Image.fromarray(picture),
        emissiveFactor=[1.0, 1.0, 1.0],
        baseColorFactor=[0, 0, 0, 255],
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    mesh = trimesh.Trimesh(
        vertices=points.reshape(-1, 3).numpy() * (1, -1, -1),
        faces=faces,
        visual=TextureVisuals(uv=uv.reshape(-1, 2), material=material),  # type: ignore[no-untyped-call]
        process=False,
    )
    mesh.remove_unreferenced_vertices()
    with atomic_write(path) as temporary:
        content: Any = mesh.export(file_type="glb")
        temporary.write_bytes(content)
    return float(-mesh.bounds[:, 2].mean()) if len(faces) else 0.0


def _faces(
    depth: Float[Tensor, "height width"], shown: Bool[Tensor, "height width"]
) -> Int[np.ndarray, "faces 3"]:
    """Two triangles for each square of four pixels, as row-major indices."""
    height, width = depth.shape
    index = np.arange(height * width).reshape(height, width)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    corners = np.concatenate([np.stack(x, -1).reshape(-1, 3) for x in ((a, c, b), (b, c, d))])
    of_corners = depth.reshape(-1).numpy()[corners]
    near = of_corners.max(1) <= (1 + _EDGE) * of_corners.min(1)
    return np.asarray(corners[near & shown.reshape(-1).numpy()[corners].all(1)])
