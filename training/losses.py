"""Errors of depth where it is known."""

import torch
import torch.nn.functional as F
from torch import Tensor

# of a cell, so much must be known for its mean to count
LEAST_OF_CELL = 0.5


def mean_over(values: Tensor, known: Tensor) -> Tensor:
    """Mean of [n, 1, height, width] over what is known of each image: [n, 1, 1, 1]."""
    count = known.sum(dim=(1, 2, 3), keepdim=True).clamp(min=1)
    return torch.where(known, values, 0).sum(dim=(1, 2, 3), keepdim=True) / count


def nearness(target: Tensor, known: Tensor) -> Tensor:
    """Weights [n, 1, height, width] of mean 1 for errors of depth in [-1, 1]: near counts more."""
    weight = 1 / (target + 1.6).clamp(min=0.1)
    return weight / mean_over(weight, known)


def gradient_loss(error: Tensor, known: Tensor) -> Tensor:
    """Mean absolute difference of neighbouring errors at four scales (MiDaS, Eq. 11)."""
    total = error.new_zeros(())
    error, share = torch.where(known, error, 0), known.float()
    for _ in range(4):
        for axis in (-1, -2):
            size = share.shape[axis] - 1
            both = share.narrow(axis, 0, size) * share.narrow(axis, 1, size) > 0
            total = total + mean_over(error.diff(dim=axis).abs(), both).mean()
        pooled, covered = F.avg_pool2d(error * share, 2), F.avg_pool2d(share, 2)
        share = (covered >= LEAST_OF_CELL).float()
        error = pooled / covered.clamp(min=LEAST_OF_CELL)
    return total


def aligned(prediction: Tensor, target: Tensor, known: Tensor) -> Tensor:
    """The prediction after its least-squares scale and shift, per image [n, 1, height, width]."""
    with torch.no_grad():
        p_mean, t_mean = mean_over(prediction, known), mean_over(target, known)
        p = prediction - p_mean
        scale = mean_over(p * (target - t_mean), known)
        scale = (scale / mean_over(p * p, known).clamp(min=1e-3)).clamp(0.5, 2)
    return scale * (prediction - p_mean) + t_mean


def regression_loss(prediction: Tensor, target: Tensor, known: Tensor) -> dict[str, Tensor]:
    """Huber error as it is and after scale and shift, near depth weighing more, and gradients.

    known: where there is a target at all, bool [n, 1, height, width].
    (The error after scale and shift alone, as in MiDaS, leaves the loss on a plateau for
    hundreds of steps from the start.)
    """
    weight = nearness(target, known)

    def huber(estimate: Tensor) -> Tensor:
        error = F.smooth_l1_loss(estimate, target, reduction="none", beta=0.2)
        return mean_over(weight * error, known).mean()

    absolute, shape = huber(prediction), huber(aligned(prediction, target, known))
    edges = gradient_loss(prediction - target, known)
    return {
        "loss": 0.4 * absolute + shape + 0.2 * edges,
        "absolute": absolute,
        "shape": shape,
        "edges": edges,
    }


def affine_errors(prediction: Tensor, depth: Tensor) -> dict[str, float]:
    """abs_rel and delta1 of one map after a least-squares scale and shift on all known pixels.

    depth: [m], 0 where unknown, of the prediction's shape.
    """
    known = depth > 0
    p, d = prediction[known].double(), depth[known].double()
    p = p - p.mean()
    scale = (p * (d - d.mean())).sum() / (p * p).sum().clamp(min=1e-12)
    metric = (scale * p + d.mean()).clamp(min=0.05)
    ratio = torch.maximum(metric / d, d / metric)
    return {
        "abs_rel": float(((metric - d).abs() / d).mean()),
        "delta1": float((ratio < 1.25).double().mean()),
    }
