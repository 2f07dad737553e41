"""What holds for every completer: arrays of any kind, seeded answers, one set of errors."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.frame import Frame
from steered_marigold.errors import InputError, NoMeasurementsError, SizeMismatchError
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.steered import SteeredCompleter
from tests.diffusion.conftest import tiny_pipeline
from tests.frames.completers import NearestCompleter

HEIGHT, WIDTH = 24, 32


class Noisy(DepthCompleter):
    """Brightness in metres and a draw from the generator; keeps the frames that it saw."""

    name = "noisy"

    def __init__(self) -> None:
        self.seen: list[Frame] = []

    def _complete(self, frame: Frame, generator: torch.Generator) -> DepthCompletion:
        self.seen.append(frame)
        brightness = frame.image.float().mean(dim=2)
        depth = (1 + brightness + torch.rand(frame.size, generator=generator))[None]
        measured = frame.valid_mask[None]
        return DepthCompletion(depth=depth, measured=measured, trusted=measured)


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(grey image uint8, depth [m] with nan where the mask is False, mask)."""
    rng = np.random.default_rng(0)
    image = np.repeat(rng.integers(0, 256, (HEIGHT, WIDTH, 1), dtype=np.uint8), 3, axis=2)
    mask = rng.random((HEIGHT, WIDTH)) < 0.3
    depth = np.where(mask, rng.uniform(0.5, 5, (HEIGHT, WIDTH)), np.nan).astype(np.float32)
    return image, depth, mask


IMAGES: dict[str, Callable[[np.ndarray], Any]] = {
    "PyTorch": torch.from_numpy,
    "PIL": Image.fromarray,
    "PIL, grey": lambda image: Image.fromarray(image[..., 0]),
    "PIL, alpha": lambda image: Image.fromarray(image).convert("RGBA"),
    "PIL, palette": lambda image: Image.fromarray(image[..., 0]).convert("P"),
    "grey": lambda image: image[..., 0],
    "one channel": lambda image: image[..., :1],
    "alpha": lambda image: np.concatenate([image, image[..., :1] // 2], axis=2),
    "16 bits": lambda image: image.astype(np.uint16) * 257,
    "floats": lambda image: image / 255,
    "half floats": lambda image: torch.from_numpy(image / 255).half(),
    "floats of a model": lambda image: torch.from_numpy(image / 255).float().requires_grad_(),
    "other strides": lambda image: np.asfortranarray(image)[:, :],
    "mirrored view": lambda image: np.ascontiguousarray(image[:, ::-1])[:, ::-1],
    "lists": lambda image: (image / 255).tolist(),
}

MEASUREMENTS: dict[str, Callable[[np.ndarray, np.ndarray], tuple[Any, Any]]] = {
    "zeros": lambda depth, mask: (np.nan_to_num(depth), None),
    "nan": lambda depth, mask: (depth, None),
    "infinite": lambda depth, mask: (np.where(mask, depth, np.inf), None),
    "negative": lambda depth, mask: (np.where(mask, depth, -1), None),
    "masked rubbish": lambda depth, mask: (np.where(mask, depth, 7), mask),
    "PyTorch": lambda depth, mask: (torch.from_numpy(depth), torch.from_numpy(mask)),
    "doubles": lambda depth, mask: (depth.astype(np.float64), mask),
    "mask of numbers": lambda depth, mask: (depth, mask.astype(np.uint8)),
    "PIL": lambda depth, mask: (Image.fromarray(depth), Image.fromarray(mask)),
    "lists": lambda depth, mask: (depth.tolist(), mask.tolist()),
}


@pytest.mark.parametrize("kind", IMAGES)
def test_an_image_of_any_kind_is_the_same_frame(kind: str) -> None:
    image, depth, mask = scene()
    method = Noisy()
    expected = method.complete(image, depth, mask)
    answer = method.complete(IMAGES[kind](image), depth, mask)
    assert torch.equal(method.seen[1].image, torch.from_numpy(image))
    assert torch.equal(answer.depth, expected.depth)


@pytest.mark.parametrize("kind", MEASUREMENTS)
def test_measurements_of_any_kind_are_the_same_frame(kind: str) -> None:
    image, depth, mask = scene()
    method = NearestCompleter()
    expected = method.complete(image, depth, mask)
    answer = method.complete(image, *MEASUREMENTS[kind](depth, mask))
    assert torch.equal(answer.depth, expected.depth)
    assert torch.equal(answer.measured, torch.from_numpy(mask)[None])


def test_whole_metres_are_metres() -> None:
    image, _, mask = scene()
    metres = np.where(mask, 3, 0).astype(np.int64)
    answer = NearestCompleter().complete(image, metres)
    torch.testing.assert_close(answer.depth, torch.full((1, HEIGHT, WIDTH), 3.0), atol=2e-3, rtol=0)


def test_what_is_not_measured_does_not_reach_the_method() -> None:
    image, depth, mask = scene()
    method = Noisy()
    K = np.array([[30, 0, 16], [0, 30, 12], [0, 0, 1]])
    method.complete(image, np.where(mask, depth, 7), mask, K, confidence=mask.astype(float))
    (frame,) = method.seen
    assert bool((frame.sparse_depth[~frame.valid_mask] == 0).all())
    assert frame.K is not None
    assert frame.confidence is not None
    assert (frame.K.dtype, frame.confidence.dtype) == (torch.float32, torch.float32)


def test_the_arrays_of_the_caller_stay_as_they_are() -> None:
    image, depth, mask = scene()
    copies = image.copy(), depth.copy(), mask.copy()
    Noisy().complete(image, depth, mask)
    for array, copy in zip((image, depth, mask), copies, strict=True):
        np.testing.assert_array_equal(array, copy)


Change = Callable[[dict[str, Any]], dict[str, Any]]
WRONG: dict[str, tuple[Change, str]] = {
    "channels first": (
        lambda a: {"image": a["image"].transpose(2, 0, 1)},
        r"`image` .*\[3, 24, 32\]; it looks like channels first: use image\.transpose",
    ),
    "two channels": (lambda a: {"image": a["image"][..., :2]}, r"`image` must be \[height, width"),
    "a batch": (lambda a: {"image": a["image"][None]}, "`image` must be"),
    "no pixels": (lambda a: {"image": a["image"][:0]}, "`image` must be"),
    "floats of 255": (lambda a: {"image": a["image"] / 1.0}, "`image` has floats from 0 to 255"),
    "floats of -1": (lambda a: {"image": a["image"] / 127.5 - 1}, "`image` has floats from -1"),
    "nan in the image": (lambda a: {"image": np.full((24, 32, 3), np.nan)}, "`image` has floats"),
    "signed image": (lambda a: {"image": a["image"].astype(np.int32)}, "`image` .*not int32"),
    "a path": (lambda a: {"image": "frame.png"}, "`image` must be an array of numbers, not str"),
    "nothing": (lambda a: {"image": None}, "`image` must be an array of numbers"),
    "depth of a batch": (
        lambda a: {"sparse_depth": a["sparse_depth"][None]},
        r"`sparse_depth` must be \[height, width\], not \[1, 24, 32\]",
    ),
    "depth of another size": (
        lambda a: {"sparse_depth": a["sparse_depth"][:-1], "valid_mask": a["valid_mask"][:-1]},
        r"`sparse_depth` is \[23, 32\] but the image \[24, 32\]",
    ),
    "mask of another size": (
        lambda a: {"valid_mask": a["valid_mask"][:-1]},
        r"`valid_mask` is \[23, 32\] but `sparse_depth` \[24, 32\]",
    ),
    "mask of depths": (
        lambda a: {"valid_mask": np.nan_to_num(a["sparse_depth"])},
        "`valid_mask` must be boolean",
    ),
    "mask of what was not measured": (
        lambda a: {"valid_mask": ~a["valid_mask"]},
        "`sparse_depth` must be finite and positive wherever `valid_mask`",
    ),
    "confidence of per cent": (
        lambda a: {"confidence": np.full((24, 32), 50.0)},
        r"`confidence` must lie in 0\.\.1",
    ),
    "confidence of another size": (
        lambda a: {"confidence": np.ones((24, 31))},
        r"`confidence` is \[24, 31\] but the image",
    ),
    "four numbers for K": (lambda a: {"K": [30, 30, 16, 12]}, "`K` must be a finite 3x3 matrix"),
    "K of nothing": (lambda a: {"K": np.zeros((3, 3))}, "`K` must be .* focal lengths positive"),
    "K turned over": (
        lambda a: {"K": np.array([[30, 0, 16], [0, 30, 12], [0, 0, 1]]).T},
        "`K` must be",
    ),
}


@pytest.mark.parametrize(("change", "problem"), WRONG.values(), ids=WRONG.keys())
def test_what_cannot_be_read_is_refused_by_its_name(change: Change, problem: str) -> None:
    arguments: dict[str, Any] = dict(
        zip(("image", "sparse_depth", "valid_mask"), scene(), strict=True)
    )
    method = Noisy()
    with pytest.raises(InputError, match=problem) as caught:
        method.complete(**arguments | change(arguments))
    assert method.seen == []
    assert isinstance(caught.value, SizeMismatchError) == (" but " in problem)


@pytest.mark.parametrize(("factor", "warns"), [(1.0, False), (1000.0, True), (3e-3, True)])
def test_a_unit_that_looks_wrong_is_a_warning(factor: float, warns: bool) -> None:
    image, depth, mask = scene()
    if not warns:
        Noisy().complete(image, factor * depth, mask)  # warnings are errors in tests
        return
    with pytest.warns(UserWarning, match=r"median depth is .* m; is `depth_scale`"):
        Noisy().complete(image, factor * depth, mask)


def test_without_measurements() -> None:
    image, depth, mask = scene()
    for method in (Noisy(), NearestCompleter()):
        with pytest.raises(NoMeasurementsError, match=f"{method.name}: nothing was measured"):
            method.complete(image, depth, np.zeros_like(mask))
    with pytest.raises(NoMeasurementsError, match="noisy"):
        Noisy().complete(image, None)
    assert not NearestCompleter().complete(image, None).metric


def test_a_completer_implements_complete() -> None:
    with pytest.raises(TypeError, match="_complete"):
        DepthCompleter()  # type: ignore[abstract]


def steered(**knobs: Any) -> SteeredCompleter:
    return SteeredCompleter(tiny_pipeline(), "tiny", num_inference_steps=2, **knobs)


def answers(method: DepthCompleter, *seeds: int | None) -> list[Tensor]:
    image, depth, mask = scene()
    generators = [None if seed is None else torch.Generator().manual_seed(seed) for seed in seeds]
    return [method.complete(image, depth, mask, generator=g).depth for g in generators]


@pytest.mark.parametrize("method", [Noisy(), steered(preset="paper")], ids=lambda m: str(m.name))
def test_the_same_call_gives_the_same_answer(method: DepthCompleter) -> None:
    torch.manual_seed(1)
    first, again, zero, one, same = answers(method, None, None, 0, 1, 1)
    assert torch.equal(first, again)
    assert torch.equal(first, zero)
    assert torch.equal(one, same)
    assert not torch.equal(zero, one)


@pytest.mark.parametrize(
    ("knobs", "name", "steers"),
    [
        ({"preset": None}, "marigold", False),
        ({"preset": "default"}, "default", False),
        ({"preset": "default", "steering_strength": 0.1}, "default", True),
        ({"preset": "paper-minmax"}, "paper-minmax", True),
        ({"preset": "paper", "steering_strength": 0.0}, "paper", False),
    ],
)
def test_a_completer_says_what_it_runs(knobs: dict[str, Any], name: str, steers: bool) -> None:
    method = steered(**knobs)
    assert (method.name, method.steers) == (name, steers)
    assert method.describe() == {
        "method": name,
        "steers": steers,
        "checkpoint": "tiny",
        "preset": name,
        "steps": 2,
        "device": "cpu",
        "dtype": "float32",
    }


def test_an_unknown_knob_is_refused_before_a_checkpoint_is_looked_for() -> None:
    with pytest.raises(InputError, match="no setting is called 'speed'"):
        SteeredCompleter.from_checkpoint("no/such/folder", speed=1)
