"""The final solve: depth that agrees with the measurements and keeps the prior's shape.

The answer u is a log depth. It minimises, over neighbouring pixels i, j and measured pixels i,

    sum w_ij (u_j - u_i - f_ij (p_j - p_i))^2 / STEP_SPREAD^2 + sum (u_i - m_i)^2 / s_i^2
        + SCREENING sum (u_i - p_i)^2

p is the prior's log depth, m the measured one, s the sensor's relative noise. The weights w are
small across depth edges of the prior and edges of the image. f goes from 0 at a measurement to 1
far from all: between near measurements a membrane is better than the prior's shape, in a hole the
prior's shape is all there is. This is a screened Poisson equation in log depth (gradient-domain
fusion: Perez, Gangnet and Blake, "Poisson image editing", SIGGRAPH 2003). Blocks of 2x2 pixels
are solved for by multigrid (`core/multigrid.py`); at full resolution a few sweeps, in strips of
rows, put the pixels of a block in their places: time and memory grow with the image alone.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from steered_marigold.core.distance import distance_to
from steered_marigold.core.multigrid import BLACK, RED, Equations, Level, Multigrid, to_phases
from steered_marigold.errors import InputError

# relative error that a step between neighbouring pixels of the prior is believed to have
STEP_SPREAD = 0.02
# log-depth difference and image difference (of 1) at which a neighbour counts half
DEPTH_EDGE = 0.01
IMAGE_EDGE = 0.015
LEAST_WEIGHT = 1e-4
# distance [px] from a measurement at which the prior's steps count 1 - 1/e
PRIOR_REACH = 5.0
# pull towards the prior as it is, per pixel of the finest level
SCREENING = 1e-6
# least relative noise of a measurement: the solve stays well conditioned
LEAST_NOISE = 1e-3
# of multigrid on blocks, and sweeps over pixels; more change the error by less than 0.5 %
ITERATIONS = 3
SWEEPS = 3
# pixels of a strip, and rows beyond it whose errors do not get into it
STRIP = 1 << 20
HALO = 2 * SWEEPS + 2
# distance [px] from which exp(-distance / PRIOR_REACH) < 0.007 counts as 0
FAR = round(5 * PRIOR_REACH)


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviation of a measurement of depth d: metres + fraction * d [m]; 0 is exact."""

    metres: float = 0.0
    fraction: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < math.inf:
                raise InputError(f"SensorNoise: `{name}` is {value}; it must be at least 0")

    @property
    def exact(self) -> bool:
        """True if measurements are to be met as they are."""
        return self.metres == 0 and self.fraction == 0

    def relative(self, depth: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """The standard deviation as a share of depth."""
        return self.fraction + self.metres / depth


def solve_log_depth(
    log_prior: Float[Tensor, "height width"],
    log_measured: Float[Tensor, "height width"],
    data_weight: Float[Tensor, "height width"],
    image: Float[Tensor, "3 height width"] | None,
) -> Float[Tensor, "height width"]:
    """The log depth u of the module's energy.

    data_weight: 1 / s_i^2 at measurements that count, 0 elsewhere; log_measured is read only
    where it is positive. image: RGB in [0, 1], or None to rely on the prior's edges alone.

    Where a strong edge runs through a block of 2x2 pixels the answer is not quite the minimum: up
    to the last sweeps both sides share one unknown. Frames with truth do not show it.
    """
    problem = _Problem(log_prior, log_measured, data_weight, image)
    # one strip is kept; several are made twice, because they are what takes memory
    kept = list(problem.strips()) if log_prior.numel() <= STRIP else None
    on_blocks = [strip.on_blocks() for strip in kept or problem.strips()]
    *matrix, data = (torch.cat(maps) for maps in zip(*on_blocks, strict=True))
    blocks = Multigrid(Equations(*matrix), iterations=ITERATIONS).solve(data)
    del on_blocks, matrix
    u = log_prior.clone()
    for strip in kept or problem.strips():
        u[strip.top : strip.bottom] += strip.refined(blocks)
    return u


@dataclass(frozen=True)
class _Strip:
    """Equations of the rows top to bottom and of a few around them, from row `first` on."""

    level: Level
    first: int
    top: int
    bottom: int

    def on_blocks(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Weight, coupling to the right and down, and data of its own blocks."""
        coarse, size = self.level.coarser(), self.level.blocks
        maps = coarse.weight, coarse.right, coarse.down, self.level.data.sum(dim=0).view(size)
        own = slice((self.top - self.first) // 2, (self.bottom - self.first + 1) // 2)
        weight, right, down, data = (m[own] for m in maps)
        return weight, right, down, data

    def refined(self, blocks: Float[Tensor, "h w"]) -> Float[Tensor, "rows width"]:
        """The unknowns u - p of its own pixels, from those of all blocks of the image."""
        begin = self.first // 2
        self.level.interpolate(blocks[begin : begin + self.level.blocks[0]])
        for _ in range(SWEEPS):
            self.level.sweep(RED + BLACK)
        return self.level.to_map()[self.top - self.first : self.bottom - self.first]


@dataclass(frozen=True)
class _Problem:
    """The arguments of `solve_log_depth`."""

    log_prior: Float[Tensor, "height width"]
    log_measured: Float[Tensor, "height width"]
    data_weight: Float[Tensor, "height width"]
    image: Float[Tensor, "3 height width"] | None

    def strips(self) -> Iterator[_Strip]:
        """The equations of the image, strip by strip."""
        height, width = self.log_prior.shape
        rows = max(STRIP // width // 2 * 2, 2)
        for top in range(0, height, rows):
            yield self._strip(top, min(top + rows, height))

    def _strip(self, top: int, bottom: int) -> _Strip:
        height = self.log_prior.shape[0]
        first, last = max(top - HALO, 0), min(bottom + HALO, height)
        rows = slice(first, last)
        prior, weight = self.log_prior[rows], self.data_weight[rows]
        image = None if self.image is None else self.image[:, rows]
        # the unknown is u - p: small, and 0 where nothing is known
        data = torch.where(weight > 0, self.log_measured[rows] - prior, 0.0).mul_(weight)
        near = self._nearness(first, last)
        right, down = (_couple(prior, image, near, data, dim) for dim in (1, 0))
        level = Level(Equations(weight + SCREENING, right, down))
        level.data.copy_(to_phases(data))
        return _Strip(level, first, top, bottom)

    def _nearness(self, first: int, last: int) -> Float[Tensor, "rows width"]:
        """1 - f of the rows first to last: 1 at a measurement, 0 far from all."""
        begin = max(first - FAR, 0)
        distance = distance_to(self.data_weight[begin : last + FAR] > 0, cap=FAR)
        distance = distance[first - begin : last - begin]
        far = distance >= FAR
        return distance.div_(-PRIOR_REACH).exp_().masked_fill_(far, 0.0)


def _couple(
    prior: Tensor, image: Tensor | None, near: Tensor, data: Tensor, dim: int
) -> Float[Tensor, "rows width"]:
    """w_ij / STEP_SPREAD^2 of each pixel and the next along dim; adds the prior's pull to data."""
    apart = 1 if dim == 1 else prior.shape[1]
    coupling, pull = torch.zeros_like(prior), torch.zeros_like(prior)
    # rows lie end to end: passes over whole maps, and the step into the next row is taken back
    w, step = coupling.view(-1)[:-apart], pull.view(-1)[:-apart]
    p, n = prior.reshape(-1), near.view(-1)
    torch.sub(p[apart:], p[:-apart], out=step)
    w.fill_(STEP_SPREAD**2).addcmul_(step, step, value=(STEP_SPREAD / DEPTH_EDGE) ** 2)
    if image is not None:
        colours = image.reshape(3, -1)
        red, green, blue = (colours[:, apart:] - colours[:, :-apart]).square_()
        most = torch.maximum(torch.maximum(red, green, out=red), blue, out=red)
        w.addcmul_(w, most, value=1 / IMAGE_EDGE**2)
    w.reciprocal_().clamp_(min=LEAST_WEIGHT / STEP_SPREAD**2)
    coupling.select(dim, -1).zero_()
    step.mul_(w).mul_((n[apart:] + n[:-apart]).mul_(0.5))
    data += pull
    data.view(-1)[apart:] -= step
    return coupling


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
    image: RGB in [0, 1]. Exact measurements (noise 0) of confidence 1 are met to the bit; without
    any measurements the depth is returned unchanged.
    """
    if not bool(trusted.any()):
        return depth
    measured = torch.where(trusted, sparse_depth, depth)
    weight = noise.relative(measured).clamp_(min=LEAST_NOISE).pow_(-2).mul_(trusted)
    if confidence is not None:
        weight = weight.mul_(confidence)
    corrected = solve_log_depth(depth.log(), measured.log_(), weight, image).exp_()
    if noise.exact:
        certain = trusted if confidence is None else trusted & (confidence >= 1)
        corrected = torch.where(certain, sparse_depth, corrected)
    return corrected
