"""Generators for the members of an ensemble and for anchors, from those of the caller."""

import torch
from diffusers.utils.torch_utils import randn_tensor
from torch import Tensor

Generators = torch.Generator | list[torch.Generator] | None


def draw_noise(
    shape: tuple[int, ...], generator: Generators, *, device: torch.device, dtype: torch.dtype
) -> Tensor:
    """Standard normal noise, drawn as diffusers draws it; one generator for each of the batch."""
    noise: Tensor = randn_tensor(shape, generator, device=device, dtype=dtype)
    return noise


def generators_of_members(generator: Generators, images: int, members: int) -> Generators:
    """One generator for each ensemble member, so that a batch draws as its images would alone.

    A single generator for several images is passed on: diffusers then draws for all at once.
    """
    if isinstance(generator, torch.Generator):
        return generator if images > 1 else [generator] * members
    return None if generator is None else [g for g in generator for _ in range(members)]


def fork_generators(generator: Generators, images: int) -> list[torch.Generator]:
    """A CPU generator for the anchors of each image, seeded from the caller's generator.

    The seed comes from a copy, so the caller's noise stream does not move.
    """
    sources = generator if isinstance(generator, list) else [generator]
    forks = []
    for source in sources:
        source = torch.default_generator if source is None else source
        copy = torch.Generator(source.device)
        copy.set_state(source.get_state())
        seed = torch.randint(2**62, (), generator=copy, device=source.device)
        forks.append(torch.Generator().manual_seed(int(seed)))
    return forks if len(forks) == images else forks * images
