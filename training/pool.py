"""Encoded samples for the denoiser stage, of which a part is renewed as the training goes.

Neither the image encoder nor the codec changes, so what they make of a sample is computed once.
A sample is for one of two tasks: to begin from noise, or to go on from what a first answer and
measurements around holes say (`training/told.py`), with several masks to a picture.
"""

from collections.abc import Callable, Iterator

import torch
import torch.nn.functional as F
from diffusers import AutoencoderKL
from torch import Tensor

from steered_marigold.diffusion.image_encoder import ImageEncoder
from training.data import image_to_model
from training.told import Told, draw_measured, tell
from training.trainer import Batch

# of a latent cell's pixels, so many must be known for its error to count
LEAST_OF_CELL = 0.9
# of each picture, so many masks are told
MASKS = 2
# decoded first answers [n, height, width] in [-1, 1], of image latents
FirstAnswer = Callable[[Tensor], Tensor]


@torch.no_grad()
def encode_depth(codec: AutoencoderKL, depth: Tensor) -> Tensor:
    """Unscaled latents of depth [n, 1, height, width] in [-1, 1]."""
    latents: Tensor = codec.encode(depth.expand(-1, 3, -1, -1)).latent_dist.mode()
    return latents


class Pool:
    """Batches of "image" latents, the "latents" to be found, and "counts", where that is a truth.

    "told" are the latents that are known where "known"; in samples that begin from noise nowhere.
    Every chunk of pictures serves one of the two tasks in turn.
    """

    def __init__(
        self,
        encoder: ImageEncoder,
        codec: AutoencoderKL,
        first: FirstAnswer,
        data: Iterator[Batch],
        size: int,
    ) -> None:
        self._encoder, self._codec, self._first, self._data = encoder, codec, first, data
        self._generator = torch.Generator().manual_seed(0)
        self._chunks = 0
        self.samples = self._encode()
        while len(self.samples["image"]) < size:
            more = self._encode()
            self.samples = {k: torch.cat([v, more[k]]) for k, v in self.samples.items()}
        self._oldest = 0

    @torch.no_grad()
    def _encode(self) -> Batch:
        batch = next(self._data)
        self._chunks += 1
        image = image_to_model(batch["image"]).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            latents = self._encoder(image)
            if self._chunks % 2:
                return self._of_noise(batch, latents)
            return self._of_told(batch, latents)

    def _of_noise(self, batch: Batch, image: Tensor) -> Batch:
        latents = encode_depth(self._codec, batch["depth"])
        counts = F.avg_pool2d(batch["known"].float(), 8) >= LEAST_OF_CELL
        return _stored(image, latents, latents, torch.zeros_like(counts), counts)

    def _of_told(self, batch: Batch, image: Tensor) -> Batch:
        found: list[tuple[int, Told]] = []
        firsts = self._first(image)
        low, high = batch["range"].T[..., None, None, None]
        metric = (low + (batch["depth"] + 1) / 2 * (high - low))[:, 0]
        for i, (first, depth) in enumerate(zip(firsts, metric, strict=True)):
            for _ in range(MASKS):
                known = batch["known"][i, 0]
                told = tell(first, depth, draw_measured(depth, known, self._generator))
                found += [] if told is None else [(i, told)]
        if not found:
            return self._of_noise(batch, image)
        index = torch.tensor([i for i, _ in found])
        latents, target = (
            encode_depth(self._codec, torch.stack(maps)[:, None])
            for maps in ([t.depth for _, t in found], [t.target for _, t in found])
        )
        counts = F.avg_pool2d(batch["known"][index].float(), 8) >= LEAST_OF_CELL
        known = torch.stack([t.known for _, t in found])[:, None]
        return _stored(image[index], target, latents, known, counts)

    def batches(self, batch_size: int, renew_every: int) -> Iterator[Batch]:
        """Endless random batches."""
        size = len(self.samples["image"])
        while True:
            for _ in range(renew_every):
                index = torch.randint(size, (batch_size,), generator=self._generator)
                yield {name: values[index] for name, values in self.samples.items()}
            fresh = self._encode()
            places = (self._oldest + torch.arange(len(fresh["image"]))) % size
            for name, values in fresh.items():
                self.samples[name][places] = values
            self._oldest = int(places[-1] + 1) % size


def _stored(image: Tensor, latents: Tensor, told: Tensor, known: Tensor, counts: Tensor) -> Batch:
    floats = {"image": image, "latents": latents, "told": told}
    return {k: v.bfloat16() for k, v in floats.items()} | {"known": known, "counts": counts}
