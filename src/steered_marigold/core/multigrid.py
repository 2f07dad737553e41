"""Linear equations on a pixel grid, solved coarse to fine.

Every pixel i has one unknown u_i and one equation,

    (weight_i + sum_j coupling_ij) u_i - sum_j coupling_ij u_j = data_i

over its four neighbours j. Multigrid (Brandt 1977; Trottenberg, Oosterlee and Schueller 2001):
red-black Gauss-Seidel sweeps, blocks of 2x2 pixels that share one correction, and conjugate
gradients around each cycle, because couplings that jump by four orders of magnitude slow it down.

A map of 2h x 2w pixels is kept as its four phases [4, h w]: the pixels that lie upper left, upper
right, lower left and lower right in their block. Neighbours in a block then have the same index,
those across its border one that differs by 1 or w, and each phase is updated by a few passes over
contiguous memory.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

# upper left and lower right; upper right and lower left: no two of a colour are neighbours
RED, BLACK, ALL = (0, 3), (1, 2), (0, 1, 2, 3)
# a grid of so many pixels is solved directly
COARSEST = 300
# least denominator: where everything is met already, nothing is left to divide
TINY = 1e-30

# (phase's elements, coupling, neighbouring phase, its elements)
_Edge = tuple[slice, Tensor, int, slice]


def to_phases(grid: Float[Tensor, "rows columns"]) -> Float[Tensor, "4 blocks"]:
    """The phases of a map, which is padded by zeros to even sides."""
    rows, columns = grid.shape
    if rows % 2 or columns % 2:
        grid = F.pad(grid, (0, columns % 2, 0, rows % 2))
    h, w = grid.shape[0] // 2, grid.shape[1] // 2
    return grid.reshape(h, 2, w, 2).permute(1, 3, 0, 2).reshape(4, h * w).contiguous()


@dataclass(frozen=True)
class Equations:
    """The matrix on one grid. right, down: coupling of each pixel to its right and its lower
    neighbour, 0 in the last column and row. weight: positive.
    """

    weight: Float[Tensor, "rows columns"]
    right: Float[Tensor, "rows columns"]
    down: Float[Tensor, "rows columns"]


class Level:
    """Equations in phases, with the unknowns u and the data that they are being solved for.

    Both stay where they are, and what is done to them works in place: on the coarse levels it is
    calls that take the time, and on the fine ones memory.
    """

    def __init__(self, equations: Equations) -> None:
        rows, columns = equations.weight.shape
        self.size = rows, columns
        self.blocks = -(-rows // 2), -(-columns // 2)
        self.right, self.down = to_phases(equations.right), to_phases(equations.down)
        self.weight = to_phases(equations.weight)
        self.u, self.data = torch.zeros_like(self.weight), torch.zeros_like(self.weight)
        self._total = torch.empty_like(self.weight)
        self.diagonal = self.weight.clone()
        for phase in range(4):
            for to, coupling, _, _ in self._edges(phase):
                self.diagonal[phase, to] += coupling
        # padding has no equation: its unknown stays 0
        self.inverse = torch.where(self.diagonal > 0, self.diagonal, 1).reciprocal_()
        phases = self.u, self.data, self._total, self.inverse
        self._views = list(zip(*(m.unbind() for m in phases), strict=True))
        self._terms = [
            [
                (self._total[phase, to], coupling, self.u[other, source])
                for to, coupling, other, source in self._edges(phase)
            ]
            for phase in range(4)
        ]

    def _edges(self, phase: int) -> list[_Edge]:
        """The four neighbours of a phase; the couplings beyond the map's border are 0."""
        w = self.blocks[1]
        row, column = divmod(phase, 2)
        beside, above = phase + 1 - 2 * column, phase + 2 - 4 * row
        return [
            *_pair(self.right, phase, beside, apart=1, second=bool(column)),
            *_pair(self.down, phase, above, apart=w, second=bool(row)),
        ]

    def coarser(self) -> Equations:
        """Half the resolution: 2x2 pixels share one correction (Galerkin, constant blocks).

        The couplings across block borders are halved: between block centres lie two steps.
        """
        weight = self.weight.sum(dim=0)
        right = (self.right[1] + self.right[3]).mul_(0.5)
        down = (self.down[2] + self.down[3]).mul_(0.5)
        return Equations(*(m.view(self.blocks) for m in (weight, right, down)))

    def sweep(self, order: tuple[int, ...]) -> None:
        """Solves the equations of each phase in turn for its own unknowns (Gauss-Seidel)."""
        for phase in order:
            u, data, total, inverse = self._views[phase]
            total.copy_(data)
            for to, coupling, neighbour in self._terms[phase]:
                to.addcmul_(coupling, neighbour)
            torch.mul(total, inverse, out=u)

    def times(self, order: tuple[int, ...] = ALL) -> Float[Tensor, "4 blocks"]:
        """The matrix times u, in the rows of some phases; overwritten by the next call of any."""
        torch.mul(self.diagonal, self.u, out=self._total)
        for phase in order:
            for to, coupling, neighbour in self._terms[phase]:
                to.addcmul_(coupling, neighbour, value=-1)
        return self._total

    def to_map(self) -> Float[Tensor, "rows columns"]:
        """The unknowns as a map."""
        h, w = self.blocks
        grid = self.u.view(2, 2, h, w).permute(2, 0, 3, 1).reshape(2 * h, 2 * w)
        return grid[: self.size[0], : self.size[1]]

    def interpolate(self, blocks: Float[Tensor, "h w"]) -> None:
        """Sets the unknowns to values at block centres, bilinearly interpolated."""
        size = (2 * self.blocks[0], 2 * self.blocks[1])
        grid = F.interpolate(blocks[None, None], size=size, mode="bilinear")
        self.u.copy_(to_phases(grid[0, 0]))


def _pair(
    couplings: Tensor, phase: int, other: int, *, apart: int, second: bool
) -> tuple[_Edge, _Edge]:
    """The edges of a phase along one axis: within the block, and to the block next to it.

    apart: index between blocks. second: whether the phase is the block's second along the axis.
    """
    before, after = slice(None, -apart), slice(apart, None)
    if second:
        return (
            (slice(None), couplings[other], other, slice(None)),
            (before, couplings[phase, before], other, after),
        )
    return (
        (slice(None), couplings[phase], other, slice(None)),
        (after, couplings[other, before], other, before),
    )


class Multigrid:
    """Solves the equations of one grid, for any data.

    iterations: conjugate-gradient steps on the finest grid, after one cycle on each coarser one.
    """

    def __init__(self, equations: Equations, *, iterations: int) -> None:
        self.iterations = iterations
        self.levels: list[Level] = []
        while equations.weight.numel() > COARSEST:
            self.levels.append(Level(equations))
            equations = self.levels[-1].coarser()
        self.coarsest = tuple(equations.weight.shape)
        self.factor = _factor(equations)

    def solve(self, data: Float[Tensor, "rows columns"]) -> Float[Tensor, "rows columns"]:
        """The unknowns u."""
        if not self.levels:
            return self._directly(data.flatten()).view(self.coarsest)
        phases = to_phases(data)
        self._cascade(0, phases)
        self._conjugate_gradients(phases)
        return self.levels[0].to_map()

    def _cascade(self, k: int, data: Float[Tensor, "4 blocks"]) -> None:
        """A first answer on level k: that of level k + 1 after a cycle, interpolated."""
        level = self.levels[k]
        blocks = data.sum(dim=0)
        if k + 1 == len(self.levels):
            level.interpolate(self._directly(blocks).view(level.blocks))
            return
        coarser = self.levels[k + 1]
        coarse = to_phases(blocks.view(level.blocks))
        self._cascade(k + 1, coarse)
        coarser.data.copy_(coarse)
        self._cycle(k + 1)
        level.interpolate(coarser.to_map())

    def _conjugate_gradients(self, data: Float[Tensor, "4 blocks"]) -> None:
        """Improves the unknowns of the finest level; a cycle is the preconditioner."""
        level = self.levels[0]
        answer = level.u.clone()
        rest = torch.sub(data, level.times(), out=level.data)
        direction, previous = torch.zeros_like(rest), torch.ones_like(rest[0, 0])
        for _ in range(self.iterations):
            level.u.zero_()
            self._cycle(0)
            energy = torch.vdot(rest.view(-1), level.u.view(-1))
            direction.mul_(energy / previous).add_(level.u)
            level.u.copy_(direction)
            image = level.times()
            step = energy / torch.vdot(direction.view(-1), image.view(-1)).clamp(min=TINY)
            answer.addcmul_(direction, step)
            rest.addcmul_(image, -step)
            previous = energy.clamp(min=TINY)
        level.u.copy_(answer)

    def _cycle(self, k: int) -> None:
        """A V-cycle: sweep, correct what is left on the coarser grid, sweep back."""
        level = self.levels[k]
        level.sweep(RED + BLACK)
        # the black equations were solved last: nothing is missing there
        image, first, second = level.times(RED), *RED
        missing = (level.data[first] - image[first]).add_(level.data[second]).sub_(image[second])
        if k + 1 == len(self.levels):
            correction = self._directly(missing)
        else:
            coarser = self.levels[k + 1]
            coarser.data.copy_(to_phases(missing.view(level.blocks)))
            coarser.u.zero_()
            self._cycle(k + 1)
            correction = coarser.to_map().reshape(-1)
        for phase in RED:  # the black unknowns follow from these
            level.u[phase] += correction
        level.sweep(BLACK + RED)

    def _directly(self, data: Float[Tensor, " pixels"]) -> Float[Tensor, " pixels"]:
        """The unknowns of the coarsest grid."""
        return torch.cholesky_solve(data[:, None], self.factor)[:, 0]


def _factor(equations: Equations) -> Float[Tensor, "pixels pixels"]:
    """The Cholesky factor of the matrix, computed in float64 on the CPU."""
    w = equations.weight.shape[1]
    weight, right, down = (
        m.flatten().double().cpu() for m in (equations.weight, equations.right, equations.down)
    )
    matrix = torch.diag(weight)
    for offset, coupling in ((1, right[:-1]), (w, down[:-w])):
        matrix.diagonal(offset).sub_(coupling)
        matrix.diagonal(-offset).sub_(coupling)
        matrix.diagonal()[: len(coupling)].add_(coupling)
        matrix.diagonal()[offset:].add_(coupling)
    factor: Tensor = torch.linalg.cholesky(matrix)
    return factor.to(equations.weight)
