"""Depth in metres that may be none: a wrong unit, or the image itself."""

from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from steered_marigold.core.notices import Notice, Notices
from steered_marigold.errors import InputError

_PLAUSIBLE_M = (0.01, 200.0)
_FAR_SHARE = 0.97  # of the largest depth: what lies above is "at the end of the range"
_LEAST_FILL_M = 9.5  # nearer ends of the range are walls
_GAP = 3.0  # how many times nearer everything else is
_FEWEST_FAR, _FEWEST_PIXELS = 0.002, 20
_MOST_BETWEEN = 0.1  # of those at the end


def scale_doubts(
    depth: Float[Tensor, "height width"], valid_mask: Bool[Tensor, "height width"]
) -> Notices:
    """What makes one doubt the unit of depth [m], or that all of it is depth.

    implausible_scale: the median is above 200 m or below 1 cm. second_mode: many measurements lie
    at the very end of the range and hardly any between them and the rest, as where a sensor
    writes a number for "nothing seen".
    """
    if not valid_mask.any():
        return ()
    measured = depth[valid_mask]
    median = float(measured.median())
    nearest, farthest = _PLAUSIBLE_M
    if not nearest <= median <= farthest:
        text = f"The median depth is {median:.4g} m; is `depth_scale`, metres per unit, right?"
        return (Notice("implausible_scale", text),)
    largest = float(measured.max())
    at_end = int((measured >= _FAR_SHARE * largest).sum())
    between = int((measured > largest / _GAP).sum()) - at_end
    if largest < _LEAST_FILL_M or at_end == len(measured) or at_end < max(_FEWEST_PIXELS, _FEWEST_FAR * len(measured)):
        return ()
    if between > _MOST_BETWEEN * at_end:
        return ()
    text = (
        f"{at_end} measurements lie near {largest:.4g} m and hardly any other beyond "
        f"{largest / _GAP:.4g} m; if they mean that nothing was seen, give `max_depth`."
    )
    return (Notice("second_mode", text),)


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
