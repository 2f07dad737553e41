"""What each denoising step predicts and where steering moves it, recorded while a frame runs."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from torch import Tensor

from steered_marigold.diffusion.codec import DepthCodec


@dataclass(frozen=True)
class SteeringStep:
    """One denoising step, of the first ensemble member, on the processing grid.

    predicted: x0D, the decoded prediction, in [-1, 1]. target: x0D - phi1 + phi2, where steering
    moves it; without steering the prediction itself.
    """

    timestep: int
    predicted: Float[Tensor, "height width"]
    target: Float[Tensor, "height width"]


def largest_move(steps: Iterable[SteeringStep]) -> float:
    """How far steering moves all but 1 % of the pixels of the steps, above 0: a picture's scale."""
    moves = (np.percentile((step.target - step.predicted).abs().numpy(), 99) for step in steps)
    return max(*map(float, moves), 1e-6)


class StepRecorder:
    """A `callback_on_step_end` that keeps every step; give the call its `tensor_inputs` too."""

    tensor_inputs = ("predicted_x0", "steering_target")

    def __init__(self) -> None:
        self.steps: list[SteeringStep] = []

    def __call__(
        self, pipe: Any, step: int, timestep: Tensor, tensors: dict[str, Any]
    ) -> dict[str, Any]:
        predicted = DepthCodec(pipe.vae).decode(tensors["predicted_x0"][:1])
        target = tensors["steering_target"]
        maps = (predicted, predicted if target is None else target)
        self.steps.append(SteeringStep(int(timestep), *(x[0].float().cpu() for x in maps)))
        return {}
