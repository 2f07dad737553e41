"""What a stream remembers, by laws: present measurements rule, age and contradiction weaken."""

from dataclasses import replace

import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.consistency import LEAST_NOISE, SensorNoise
from steered_marigold.core.frame import Frame
from steered_marigold.core.memory import AGE_NOISE, StreamMemory
from steered_marigold.core.registration import Registration
from steered_marigold.core.warping import warp_depth

K = torch.tensor([[20.0, 0, 9.5], [0, 20.0, 7.5], [0, 0, 1]])
SIZE = (16, 20)


def _still(depth: Tensor, mask: Tensor) -> Registration:
    return warp_depth(depth, mask, K, torch.eye(4))


def _frame(seed: int, share: float = 0.5, depth: Tensor | None = None) -> Frame:
    """A grey image and a part of the measurements of a gentle slope."""
    generator = torch.Generator().manual_seed(seed)
    slope = torch.linspace(2.0, 2.1, SIZE[1]).repeat(SIZE[0], 1) if depth is None else depth
    mask = torch.rand(SIZE, generator=generator) < share
    image = torch.full((*SIZE, 3), 128, dtype=torch.uint8)
    return Frame(image=image, sparse_depth=torch.where(mask, slope, 0.0), valid_mask=mask, K=K)


@given(st.integers(0, 100))
def test_holes_are_filled_with_what_was_measured(seed: int) -> None:
    """A camera that stands still: each pixel that was ever measured is known."""
    memory = StreamMemory()
    first, second = _frame(seed), _frame(seed + 1)
    alone = memory.recall(first, None)
    assert alone.frame is first
    assert not alone.remembered.any()
    recalled = memory.recall(second, _still)
    assert torch.equal(recalled.remembered, first.valid_mask & ~second.valid_mask)
    assert torch.equal(recalled.frame.valid_mask, first.valid_mask | second.valid_mask)
    expected = torch.where(second.valid_mask, second.sparse_depth, first.sparse_depth)
    assert torch.allclose(recalled.frame.sparse_depth, expected)
    kept = second.valid_mask
    assert torch.equal(recalled.frame.sparse_depth[kept], second.sparse_depth[kept])


def test_age_weakens_as_its_noise_says() -> None:
    memory = StreamMemory(SensorNoise(fraction=0.01))
    memory.recall(_frame(0, share=1.0), None)
    for age in range(1, 10):
        recalled = memory.recall(_frame(age, share=0.0), _still)
        assert recalled.frame.confidence is not None
        expected = 0.01**2 / (0.01**2 + age * AGE_NOISE**2)
        assert torch.allclose(recalled.frame.confidence, torch.tensor(expected))


def test_what_is_too_old_is_forgotten() -> None:
    memory = StreamMemory()
    memory.recall(_frame(0, share=1.0), None)
    filled = [memory.recall(_frame(i, share=0.0), _still).remembered.all() for i in range(400)]
    assert filled[0]
    assert not filled[-1]


def test_contradiction_weakens_what_is_near() -> None:
    """The left half is measured again, 3 % farther: what is remembered beside it counts less."""
    slope = torch.full(SIZE, 2.0)
    left = torch.zeros(SIZE, dtype=torch.bool)
    left[:, :10] = True
    confidences = []
    for factor in (1.0, 1.03):
        memory = StreamMemory()
        memory.recall(_frame(0, share=1.0, depth=slope), None)
        again = _frame(1, share=1.0, depth=factor * slope).keep(left)
        recalled = memory.recall(again, _still)
        assert torch.equal(recalled.remembered, ~left)
        assert recalled.frame.confidence is not None
        confidences.append(recalled.frame.confidence[~left])
    assert (confidences[1] < 0.5 * confidences[0]).all()


def test_another_colour_is_another_thing() -> None:
    memory = StreamMemory()
    memory.recall(_frame(0, share=1.0), None)
    changed = _frame(1, share=0.0)
    image = changed.image.clone()
    image[:, 10:] = 20
    recalled = memory.recall(replace(changed, image=image), _still)
    assert recalled.remembered[:, :10].all()
    assert not recalled.remembered[:, 10:].any()


def test_own_confidence_is_kept() -> None:
    memory = StreamMemory()
    memory.recall(_frame(0, share=1.0), None)
    confidence = torch.rand(SIZE, generator=torch.Generator().manual_seed(0))
    frame = replace(_frame(1), confidence=confidence)
    recalled = memory.recall(frame, _still)
    assert recalled.frame.confidence is not None
    own = frame.valid_mask
    assert torch.equal(recalled.frame.confidence[own], confidence[own])
    weight = LEAST_NOISE**2 / (LEAST_NOISE**2 + AGE_NOISE**2)
    assert torch.allclose(recalled.frame.confidence[~own], torch.tensor(weight))


def test_a_cut_forgets() -> None:
    memory = StreamMemory()
    memory.recall(_frame(0, share=1.0), None)
    assert not memory.recall(_frame(1), None).remembered.any()
    memory.reset()
    assert not memory.recall(_frame(2), _still).remembered.any()


def _completion(depth: Tensor, uncertainty: float | None = 0.1) -> DepthCompletion:
    nothing = torch.zeros((1, *SIZE), dtype=torch.bool)
    sigma = None if uncertainty is None else torch.full((1, *SIZE), uncertainty)
    return DepthCompletion(depth=depth[None], measured=nothing, trusted=nothing, uncertainty=sigma)


def test_answers_are_steadier_and_closer_to_their_mean() -> None:
    """Independent errors of 3 %: the average of many has less, and changes less."""
    generator = torch.Generator().manual_seed(0)
    memory, raw, settled = StreamMemory(), [], []
    for i in range(20):
        depth = 2.0 * torch.exp(0.03 * torch.randn(SIZE, generator=generator))
        frame = _frame(i, share=0.0)
        answer = memory.settle(frame, _completion(depth), None if i == 0 else _still)
        raw.append(depth)
        settled.append(answer.depth[0])
    change = [torch.stack(x[10:]).diff(dim=0).abs().mean() for x in (raw, settled)]
    error = [(torch.stack(x[10:]) - 2).abs().mean() for x in (raw, settled)]
    assert change[1] < 0.5 * change[0]
    assert error[1] < 0.6 * error[0]


def test_known_pixels_and_other_surfaces_are_left_alone() -> None:
    memory = StreamMemory()
    memory.settle(_frame(0, share=0.0), _completion(torch.full(SIZE, 2.0)), None)
    frame = _frame(1, share=0.3)
    depth = torch.full(SIZE, 2.1)
    depth[:, 10:] = 3.0
    answer = memory.settle(frame, _completion(depth), _still).depth[0]
    assert torch.equal(answer[frame.valid_mask], depth[frame.valid_mask])
    assert torch.equal(answer[:, 10:], depth[:, 10:])
    free = ~frame.valid_mask[:, :10]
    assert (answer[:, :10][free] < 2.1).all()
    assert (answer[:, :10][free] > 2.0).all()


def test_without_uncertainty_answers_stay() -> None:
    memory = StreamMemory()
    for i in range(2):
        completion = _completion(torch.full(SIZE, 2.0 + i), uncertainty=None)
        assert memory.settle(_frame(i), completion, _still) is completion
