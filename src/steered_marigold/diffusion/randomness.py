"""Generators for the members of an ensemble and for anchors, from those of the caller."""

import torch
from torch import Tensor

Generators = torch.Generator | list[torch.Generator] | None


def draw_noise(
    shape: tuple[int, ...], generator: Generators, *, device: torch.device, dtype: torch.dtype
) -> Tensor:
    """Standard normal noise, drawn as diffusers draws it; one generator for each of the batch.

    With a CPU generator it is drawn on the CPU, so that a seed gives the same on every device.
    """
    if isinstance(generator, list) and len(generator) > 1:
        parts = [draw_noise((1, *shape[1:]), g, device=device, dtype=dtype) for g in generator]
        return torch.cat(parts)
    one = generator[0] if isinstance(generator, list) else generator
    home = device if one is None else one.device
    return torch.randn(shape, generator=one, device=home, dtype=dtype).to(device)


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
