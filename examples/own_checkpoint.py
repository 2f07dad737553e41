"""A Marigold-format checkpoint in a folder, used as any diffusers pipeline.

    python -m examples.own_checkpoint FOLDER

FOLDER is what `save_pretrained` writes: model_index.json, unet/, vae/, scheduler/, text_encoder/
and tokenizer/, as of prs-eth/marigold-depth-v1-1 or of your own fine-tuning.
"""

import sys
from pathlib import Path
from typing import Any

import torch
from PIL import Image

from steered_marigold import DepthCompletion, SteeredMarigoldPipeline
from steered_marigold.io.depth_maps import read_depth

SAMPLE = Path(__file__).parents[1] / "src" / "steered_marigold" / "assets" / "sample"


def main(folder: Path, *, steps: int = 4) -> DepthCompletion:
    """Completes the sample frame, steered, and says after each step where it is."""
    pipe = SteeredMarigoldPipeline.from_pretrained(folder, use_safetensors=True)
    pipe.set_progress_bar_config(disable=True)
    sensor = read_depth(SAMPLE / "depth.png")

    def tell(pipe: Any, step: int, timestep: int, tensors: dict[str, Any]) -> dict[str, Any]:
        print(f"step {step + 1} of {steps}, timestep {int(timestep)}")
        return {}

    completion: DepthCompletion = pipe(
        Image.open(SAMPLE / "image.jpg"),
        sensor.depth,
        sensor.valid_mask,
        num_inference_steps=steps,
        steering_strength=0.1,
        ensemble_size=1,
        mirror=False,
        continuation=False,  # asks for weights that were trained for it
        generator=torch.Generator().manual_seed(0),
        callback_on_step_end=tell,
    )
    return completion


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))
