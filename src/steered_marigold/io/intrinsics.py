"""Camera intrinsics: the record, and what becomes of it for an image of another size."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from steered_marigold.core.geometry import resize_intrinsics
from steered_marigold.core.notices import Notice, Notices
from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.camera_files import Camera, camera_text, parse_camera
from steered_marigold.io.files import AnyPath, decoding

_NORMALISED_BELOW = 2.0
_SAME_ASPECT = 0.01
_FAR_FROM_MIDDLE = 0.2  # of the image's width or height


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """A pinhole camera.

    K: [px], or in widths and heights of the image where `normalised`. Pixel centres are at integer
        coordinates.
    size: (height, width) [px] of the images that K belongs to; None if nothing tells it.
    distortion: OpenCV's coefficients k1, k2, p1, p2, k3 ...; None if nothing tells them.
    notes: what was read otherwise than written.
    """

    K: Float[Tensor, "3 3"]
    size: tuple[int, int] | None = None
    distortion: tuple[float, ...] | None = None
    notes: Notices = ()

    @property
    def normalised(self) -> bool:
        """Whether K is in widths and heights instead of pixels."""
        return all(float(self.K[index]) < _NORMALISED_BELOW for index in _FOUR)

    def for_image(self, size: tuple[int, int]) -> tuple[Float[Tensor, "3 3"], Notices]:
        """K [px] of an image of `size` (height, width), and what was done or is doubtful.

        A K of another resolution is scaled where its size is known or it is normalised.

        Raises InputError if that size has another aspect ratio, or if the principal point does
        not lie in the image.
        """
        (height, width), notes = size, self.notes
        K, resized = self.K, f"{width}x{height} px of the image"
        if self.normalised:
            K = _unit_to_pixels(K, size)
            text = f"The normalised intrinsics were scaled to the {resized}."
            notes = (*notes, Notice("intrinsics_scaled", text))
        elif self.size is not None and self.size != size:
            own = f"{self.size[1]}x{self.size[0]} px"
            if abs(self.size[1] * height / (self.size[0] * width) - 1) > _SAME_ASPECT:
                raise InputError(
                    f"`intrinsics` are of {own}, another aspect ratio than the {resized}; give "
                    "those of the image (a crop moves the principal point)"
                )
            K = resize_intrinsics(K, size=self.size, new_size=size)
            text = f"The intrinsics of {own} were scaled to the {resized}."
            notes = (*notes, Notice("intrinsics_scaled", text))
        cx, cy = float(K[0, 2]), float(K[1, 2])
        if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
            raise InputError(
                f"the principal point ({cx:g}, {cy:g}) of `intrinsics` lies outside the {resized}: "
                "they are of another resolution; append its width and height, as "
                "fx,fy,cx,cy,width,height, and they are scaled"
            )
        off = max(abs(2 * cx / (width - 1 or 1) - 1), abs(2 * cy / (height - 1 or 1) - 1)) / 2
        if min(size) > 1 and off > _FAR_FROM_MIDDLE:
            text = (
                f"The principal point ({cx:g}, {cy:g}) lies far from the middle of the {resized}; "
                "are `intrinsics` of this resolution?"
            )
            notes = (*notes, Notice("intrinsics_off_centre", text))
        return K, notes


_FOUR = ((0, 0), (1, 1), (0, 2), (1, 2))


def read_intrinsics(source: AnyPath) -> Intrinsics:
    """Intrinsics from "fx,fy,cx,cy" or "fx,fy,cx,cy,width,height", or from a file.

    A file holds the same numbers, a 3x3 or 4x4 K, fx fy cx cy and distortion (TUM), or is ROS
    camera_info or Kalibr, OpenCV or ORB-SLAM YAML, Open3D, RealSense, Record3D or nerfstudio JSON,
    a K as .npy, KITTI calibration, COLMAP cameras.txt, Middlebury calib.txt or the metadata of a
    RealSense frame. Lines that begin with # are comments.

    Raises FileFormatError if it is none of these, or not a pinhole camera.
    """
    text = camera_text(source)
    with decoding(source):
        try:
            return _checked(parse_camera(text))
        except FileFormatError as error:
            raise FileFormatError(f"{source}: {error}") from error


def _checked(camera: Camera) -> Intrinsics:
    K = torch.tensor(camera.matrix, dtype=torch.float32).reshape(3, 3)
    if not (K[0, 0] > 0 and K[1, 1] > 0 and K[1, 0] == 0 and K[2].tolist() == [0, 0, 1]):
        raise FileFormatError(
            "K must be [fx, skew, cx; 0, fy, cy; 0, 0, 1] with positive focal lengths"
        )
    coefficients = tuple(camera.distortion or ())
    if not (torch.isfinite(K).all() and torch.tensor(coefficients).isfinite().all()):
        raise FileFormatError("holds a number that is not finite, or no float32")
    if camera.size is not None and min(camera.size) < 1:
        raise FileFormatError("names a width or height that is no number of pixels")
    return Intrinsics(
        K=K,
        size=camera.size,
        distortion=coefficients if any(coefficients) else None,
        notes=camera.notes,
    )


def _unit_to_pixels(K: Float[Tensor, "3 3"], size: tuple[int, int]) -> Float[Tensor, "3 3"]:
    """From widths and heights, measured from the image's border, to pixels between centres."""
    return resize_intrinsics(
        K - torch.tensor([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]), size=(1, 1), new_size=size
    )
