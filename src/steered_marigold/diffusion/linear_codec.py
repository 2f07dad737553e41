"""A linear stand-in for the VAE between exact steps of steering.

Steering reads decoded depth at the measurements, and needs the latents of a smooth change of depth.
Over a neighbourhood of latents both are close to linear in the latents, in their saturation and in
the change. So both maps are fitted while the run goes on, by ridge regression over the thousands of
latent positions of exact steps:

| map | from 3x3 positions | to the middle position |
|---|---|---|
| decode | latents z, tanh z | 2x2 depths |
| encode | 2x2 changes of depth, z, tanh z | change of the latents |
"""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from steered_marigold.diffusion.codec import DepthCodec

# relative to the mean square of the inputs
RIDGE = 1e-4
# weight of an exact step when the next one is added
MEMORY = 0.5
# differences to the exact codec that count as agreement: mean absolute depth (of a range of 2), and
# root mean square of the latents' change as a share of the exact one
DECODE_TOLERANCE = 0.04
ENCODE_TOLERANCE = 0.4
# steps between two exact ones, at most
LONGEST = 8


class LinearCodec:
    """Takes the place of a `DepthCodec` in the denoising loop, which in each step decodes x0~ and
    encodes the target that it made from it.

    The first two steps are exact, one to fit and one to check the fit. After each check that is
    passed twice as many steps do without the VAE, up to `LONGEST`; after one that is failed the
    next step is exact again. exact_steps, linear_steps: how many there were.
    """

    def __init__(self, exact: DepthCodec) -> None:
        self.exact = exact
        self.exact_steps = self.linear_steps = 0
        self._decoder, self._encoder = _RidgeMap(), _RidgeMap()
        self._stretch = self._left = 0

    def decode(
        self, latents: Float[Tensor, "batch channels h w"]
    ) -> Float[Tensor, "batch height width"]:
        """Depth maps in [-1, 1]."""
        self._latents, self._dtype = latents.float(), latents.dtype
        self._seen = torch.cat([self._latents, self._latents.tanh()], dim=1)
        if self._left == 0:
            self._decoded = self.exact.decode(latents)
        else:
            coarse = F.pixel_shuffle(self._decoder(self._seen), 2)
            size = self._decoded.shape[-2:]
            self._decoded = F.interpolate(coarse, size, mode="bilinear")[:, 0].clamp(-1, 1)
        return self._decoded

    def encode(
        self, depth: Float[Tensor, "batch height width"]
    ) -> Float[Tensor, "batch channels h w"]:
        """Latents of the target made from what `decode` returned last."""
        change = torch.cat([self._halves(depth - self._decoded), self._seen], dim=1)
        if self._left > 0:
            self._left -= 1
            self.linear_steps += 1
            return (self._latents + self._encoder(change)).to(self._dtype)
        encoded = self.exact.encode(depth)
        self.exact_steps += 1
        depths, moved = self._halves(self._decoded), encoded.float() - self._latents
        if self._agrees(depths, change, moved):
            self._stretch = min(max(1, 2 * self._stretch), LONGEST)
            self._left = self._stretch
        else:
            self._stretch = 0
        self._decoder.learn(self._seen, depths)
        self._encoder.learn(change, moved)
        return encoded

    def _halves(self, depth: Tensor) -> Tensor:
        """Means over quarters of latent cells: [batch, 4, h, w]."""
        half = depth.shape[-1] // self._latents.shape[-1] // 2
        return F.pixel_unshuffle(F.avg_pool2d(depth.float()[:, None], half), 2)

    def _agrees(self, depths: Tensor, change: Tensor, moved: Tensor) -> bool:
        """Whether the maps as fitted so far foretell this exact step."""
        if self.exact_steps < 2:
            return False
        decode_error = (self._decoder(self._seen) - depths).abs().mean()
        encode_error = (self._encoder(change) - moved).square().mean().sqrt()
        limit = ENCODE_TOLERANCE * moved.square().mean().sqrt()
        return bool((decode_error < DECODE_TOLERANCE) & (encode_error < limit))


class _RidgeMap:
    """A linear map of 3x3 neighbourhoods with an offset, fitted to maps of which old ones fade."""

    def __init__(self) -> None:
        self._gram: Tensor | float = 0.0
        self._cross: Tensor | float = 0.0
        self._matrix: Tensor

    def learn(
        self, inputs: Float[Tensor, "batch channels h w"], outputs: Float[Tensor, "batch out h w"]
    ) -> None:
        """Adds a batch and fits anew."""
        x, y = self._rows(inputs), outputs.movedim(1, -1).flatten(0, 2)
        self._gram = MEMORY * self._gram + x.T @ x
        self._cross = MEMORY * self._cross + x.T @ y
        ridge = RIDGE * self._gram.diagonal().mean() * torch.eye(x.shape[1], device=x.device)
        # unlike `solve`, this does not wait for the device
        self._matrix = torch.linalg.solve_ex(self._gram + ridge, self._cross).result

    def __call__(
        self, inputs: Float[Tensor, "batch channels h w"]
    ) -> Float[Tensor, "batch out h w"]:
        rows = self._rows(inputs) @ self._matrix
        return rows.view(len(inputs), *inputs.shape[-2:], -1).movedim(-1, 1)

    def _rows(self, maps: Tensor) -> Tensor:
        """[batch * h * w, 9 * channels + 1]: each position's neighbourhood, and 1."""
        padded = F.pad(maps, (1, 1, 1, 1), mode="replicate")
        neighbourhoods = F.unfold(padded, 3).movedim(1, -1).flatten(0, 1)
        return F.pad(neighbourhoods, (0, 1), value=1.0)
