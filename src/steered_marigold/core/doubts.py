"""Depth in metres that may be none: a wrong unit, or the image itself."""

from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.core.notices import Notice, Notices
from steered_marigold.core.thinning import thinned
from steered_marigold.errors import InputError

_PLAUSIBLE_M = (0.01, 200.0)
_BLANK = 6  # of 255: the noise of a lens that is covered


def scale_doubts(
    depth: Float[Tensor, "height width"], valid_mask: Bool[Tensor, "height width"]
) -> Notices:
    """A notice if the median depth [m] is above 200 m or below 1 cm: a wrong unit, most likely."""
    if not valid_mask.any():
        return ()
    measured = depth[valid_mask]
    median = float(measured.median())
    nearest, farthest = _PLAUSIBLE_M
    if not nearest <= median <= farthest:
        text = f"The median depth is {median:.4g} m; is `depth_scale`, metres per unit, right?"
        return (Notice("implausible_scale", text),)
    return ()


def blank_image_doubts(image: UInt8[Tensor, "height width 3"]) -> Notices:
    """A notice if all but the extreme pixels of an image have one colour: it tells no depth."""
    codes = thinned(image.flatten(0, 1)).float()
    low, high = codes.quantile(codes.new_tensor([0.01, 0.99]), dim=0)
    if bool((high - low > _BLANK).any()):
        return ()
    text = "The image is of one colour, so nothing in it tells depth: is it the right one?"
    return (Notice("blank_image", text),)


def require_another_image(
    image: UInt8[Tensor, "height width 3"],
    depth: Float[Tensor, "height width"],
    valid_mask: Bool[Tensor, "height width"],
) -> None:
    """InputError if the image is the depth map itself, as a picture.

    An image in colour, or of constant depth, never is.
    """
    grey = image[..., 0]
    if not (image == grey[..., None]).all() or not valid_mask.any():
        return
    measured, seen = depth[valid_mask].double(), grey[valid_mask].double()
    bright = (seen > 32) & (seen < 255)
    if measured.max() == measured.min() or bright.sum() < 16:
        return
    factor = (seen / measured)[bright].median()
    apart = ((measured * factor).clamp(max=255) - seen).abs()
    if (apart < 1.5).double().mean() > 0.99:
        raise InputError(
            "the image is the depth map itself; give the colour or infrared image that belongs to "
            "it"
        )
