"""The final solve: depth that agrees with the measurements and keeps the prior's shape.

The answer u is a log depth. It minimises, over neighbouring pixels i, j and measured pixels i,

    sum w_ij (u_j - u_i - f_ij (p_j - p_i))^2 / STEP_SPREAD^2 + sum (u_i - m_i)^2 / s_i^2
        + SCREENING sum (u_i - p_i)^2

p is the prior's log depth, m the measured one, s the sensor's relative noise. The weights w are
small across depth edges of the prior and edges of the image. f goes from 0 at a measurement to 1
far from all: between near measurements a membrane is better than the prior's shape, in a hole the
prior's shape is all there is. This is a screened Poisson equation in log depth (gradient-domain
fusion: Perez, Gangnet and Blake, "Poisson image editing", SIGGRAPH 2003), solved coarse to fine
(cascadic multigrid: Bornemann and Deuflhard 1996): a fixed number of preconditioned
conjugate-gradient steps a level, each level starting from the coarser one's answer.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from scipy import ndimage
from torch import Tensor

# relative error that a step between neighbouring pixels of the prior is believed to have
STEP_SPREAD = 0.02
# log-depth difference and image difference (of 1) at which a neighbour counts half
DEPTH_EDGE = 0.01
IMAGE_EDGE = 0.015
# distance [px] from a measurement at which the prior's steps count 1 - 1/e
PRIOR_REACH = 5.0
# pull towards the prior as it is, per pixel of the finest level
SCREENING = 1e-6
# least relative noise of a measurement: the solve stays well conditioned
LEAST_NOISE = 1e-3
ITERATIONS = (60, 40, 30, 20, 14, 10)
COARSEST = 12


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviation of a measurement of depth d: metres + fraction * d [m]; 0 is exact."""

    metres: float = 0.0
    fraction: float = 0.0

    @property
    def exact(self) -> bool:
        """True if measurements are to be met as they are."""
        return self.metres == 0 and self.fraction == 0

    def relative(self, depth: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """The standard deviation as a share of depth."""
        return self.fraction + self.metres / depth


@dataclass(frozen=True)
class _Level:
    """One resolution: right-hand side and matrix of the normal equations on a grid."""

    data: Tensor
    """data weight x m, [1, 1, height, width]"""
    weight: Tensor
    """data weight + screening"""
    right: Tensor
    """coupling to the right neighbour, [1, 1, height, width - 1]"""
    down: Tensor
    """coupling to the lower neighbour, [1, 1, height - 1, width]"""

    def apply(self, r: Tensor) -> Tensor:
        """The matrix times r."""
        result = self.weight * r
        horizontal = self.right * (r[..., 1:] - r[..., :-1])
        result[..., :-1] -= horizontal
        result[..., 1:] += horizontal
        vertical = self.down * (r[..., 1:, :] - r[..., :-1, :])
        result[..., :-1, :] -= vertical
        result[..., 1:, :] += vertical
        return result

    def diagonal(self) -> Tensor:
        """The matrix's diagonal."""
        diagonal = self.weight.clone()
        diagonal[..., :-1] += self.right
        diagonal[..., 1:] += self.right
        diagonal[..., :-1, :] += self.down
        diagonal[..., 1:, :] += self.down
        return diagonal

    def coarser(self) -> "_Level":
        """Half the resolution: 2x2 pixels share one correction (Galerkin, constant blocks).

        The couplings across block borders are halved: between block centres lie two steps.
        """
        height, width = self.data.shape[-2:]
        odd_rows, odd_columns = (0, 0, 0, height % 2), (0, width % 2, 0, 0)
        pad = (0, width % 2, 0, height % 2)
        data, weight = (4 * F.avg_pool2d(F.pad(x, pad), 2) for x in (self.data, self.weight))
        right = F.avg_pool2d(F.pad(self.right[..., 1::2], odd_rows), (2, 1))
        down = F.avg_pool2d(F.pad(self.down[..., 1::2, :], odd_columns), (1, 2))
        return _Level(data, weight, right, down)


def solve_log_depth(
    log_prior: Float[Tensor, "height width"],
    log_measured: Float[Tensor, "height width"],
    data_weight: Float[Tensor, "height width"],
    image: Float[Tensor, "3 height width"] | None,
) -> Float[Tensor, "height width"]:
    """The log depth u of the module's energy.

    data_weight: 1 / s_i^2 at measurements that count, 0 elsewhere; log_measured is read only
    where it is positive. image: RGB in [0, 1], or None to rely on the prior's edges alone.
    """
    prior = log_prior[None, None]
    colour = None if image is None else image[None]
    right, down = (_coupling(prior, colour, dim) / STEP_SPREAD**2 for dim in (3, 2))
    # the unknown is u - p: small, and 0 where nothing is known
    residual = torch.where(data_weight > 0, log_measured - log_prior, 0.0)
    data = (data_weight * residual)[None, None]
    distrust = _nearness(data_weight > 0)[None, None]
    for dim, coupling in ((3, right), (2, down)):
        steps = coupling.shape[dim]
        pair = (distrust.narrow(dim, 0, steps) + distrust.narrow(dim, 1, steps)) / 2
        pull = coupling * pair * prior.diff(dim=dim)
        data.narrow(dim, 0, steps).add_(pull)
        data.narrow(dim, 1, steps).sub_(pull)
    levels = [_Level(data, (data_weight + SCREENING)[None, None], right, down)]
    while min(levels[-1].data.shape[-2:]) > COARSEST:
        levels.append(levels[-1].coarser())
    r = torch.zeros_like(levels[-1].data)
    for i, level in enumerate(reversed(levels)):
        if i > 0:
            r = F.interpolate(r, size=level.data.shape[-2:], mode="bilinear")
        r = _conjugate_gradient(level, r, ITERATIONS[min(i, len(ITERATIONS) - 1)])
    return log_prior + r[0, 0]


def _nearness(measured: Bool[Tensor, "height width"]) -> Float[Tensor, "height width"]:
    """1 - f of each pixel: 1 at a measurement, 0 far from all."""
    distance = ndimage.distance_transform_edt(~measured.cpu().numpy())
    nearness: Tensor = torch.exp(torch.from_numpy(distance).float() / -PRIOR_REACH)
    return nearness.to(measured.device)


def _coupling(prior: Tensor, image: Tensor | None, dim: int) -> Tensor:
    """w_ij in (0, 1] between neighbours along `dim`."""
    step = prior.diff(dim=dim).abs() / DEPTH_EDGE
    weight = 1 / (1 + step**2)
    if image is not None:
        contrast = image.diff(dim=dim).abs().amax(dim=1, keepdim=True) / IMAGE_EDGE
        weight = weight / (1 + contrast**2)
    return weight.clamp(min=1e-4)


def _conjugate_gradient(level: _Level, r: Tensor, iterations: int) -> Tensor:
    """Jacobi-preconditioned conjugate gradients, a fixed number of steps."""
    inverse = 1 / level.diagonal()
    rest = level.data - level.apply(r)
    z = inverse * rest
    direction, energy = z, (rest * z).sum()
    for _ in range(iterations):
        image = level.apply(direction)
        alpha = energy / (direction * image).sum().clamp(min=1e-30)
        r = r + alpha * direction
        rest = rest - alpha * image
        z = inverse * rest
        previous, energy = energy, (rest * z).sum()
        direction = z + energy / previous.clamp(min=1e-30) * direction
    return r


def agree_with_measurements(
    depth: Float[Tensor, "height width"],
    sparse_depth: Float[Tensor, "height width"],
    trusted: Bool[Tensor, "height width"],
    *,
    noise: SensorNoise,
    confidence: Float[Tensor, "height width"] | None = None,
    image: Float[Tensor, "3 height width"] | None = None,
) -> Float[Tensor, "height width"]:
    """Depth [m] corrected to meet the trusted measurements [m] to within the sensor's noise.

    depth: positive. confidence: in [0, 1], divides the noise's variance; None is 1 everywhere.
    image: RGB in [0, 1]. With exact measurements (noise 0 and no confidence) the result equals
    them; without any the depth is returned unchanged.
    """
    if not bool(trusted.any()):
        return depth
    measured = torch.where(trusted, sparse_depth, depth)
    spread = noise.relative(measured).clamp(min=LEAST_NOISE)
    weight = torch.where(trusted, 1 / spread**2, 0.0)
    if confidence is not None:
        weight = weight * confidence
    corrected = solve_log_depth(depth.log(), measured.log(), weight, image).exp()
    if noise.exact and confidence is None:
        corrected = torch.where(trusted, sparse_depth, corrected)
    return corrected
