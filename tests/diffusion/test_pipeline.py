"""The pipeline: stock Marigold at strength 0, Eq. 11 otherwise, and what diffusers users expect."""

from pathlib import Path
from typing import Any

import diffusers
import numpy as np
import pytest
import torch
from diffusers import MarigoldDepthPipeline
from PIL import Image

from steered_marigold.core.completion import DepthCompletion
from steered_marigold.core.consistency import SensorNoise
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from steered_marigold.diffusion.settings import PRESETS
from steered_marigold.errors import InputError, NoMeasurementsError, SizeMismatchError
from tests.diffusion.conftest import tiny_steering_vae

HEIGHT, WIDTH = 60, 84


def frame(seed: int = 0, share: float = 0.1) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """(image in [0, 1], depth [m], mask)."""
    generator = torch.Generator().manual_seed(seed)
    image = torch.rand(3, HEIGHT, WIDTH, generator=generator)
    depth = torch.rand(HEIGHT, WIDTH, generator=generator) * 3 + 1
    return image, depth, torch.rand(HEIGHT, WIDTH, generator=generator) < share


def seeded(seed: int = 5) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def stock(pipeline: SteeredMarigoldPipeline) -> Any:
    ours = pipeline._optional_components
    components = {k: v for k, v in pipeline.components.items() if k not in ours}
    pipe = MarigoldDepthPipeline(
        **components,
        prediction_type="depth",
        default_denoising_steps=3,
        default_processing_resolution=48,
    )
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.mark.parametrize("scheduler", ["DDPMScheduler", "DDIMScheduler", "LCMScheduler"])
def test_strength_0_is_stock_marigold_bit_for_bit(
    pipeline: SteeredMarigoldPipeline, scheduler: str
) -> None:
    pipeline.scheduler = getattr(diffusers, scheduler).from_config(pipeline.scheduler.config)
    image, depth, mask = frame()
    arguments: dict[str, Any] = {"generator": seeded()}
    if scheduler == "DDIMScheduler":
        arguments = {"latents": torch.randn(1, 4, 5, 6, generator=seeded())}
    expected = stock(pipeline)(image, output_type="pt", **arguments).prediction
    arguments = arguments if "latents" in arguments else {"generator": seeded()}
    steps = count_steps(pipeline)
    answer = pipeline(image, depth, mask, preset=None, **arguments)
    assert torch.equal(answer.affine_depth, expected[:, 0])
    assert len(steps) == 3


def count_steps(pipeline: SteeredMarigoldPipeline) -> list[int]:
    """A list that grows with each call of the scheduler's step."""
    calls: list[int] = []
    step = pipeline.scheduler.step

    def counted(*args: Any, **kwargs: Any) -> Any:
        calls.append(1)
        return step(*args, **kwargs)

    pipeline.scheduler.step = counted
    return calls


@pytest.mark.parametrize("kind", ["epsilon", "sample", "v_prediction"])
@pytest.mark.parametrize("scheduler", ["DDPMScheduler", "DDIMScheduler", "LCMScheduler"])
def test_every_scheduler_and_prediction_type_steers(
    pipeline: SteeredMarigoldPipeline, scheduler: str, kind: str
) -> None:
    config = dict(pipeline.scheduler.config) | {"prediction_type": kind}
    pipeline.scheduler = getattr(diffusers, scheduler).from_config(config)
    image, depth, mask = frame()
    runs = [
        pipeline(image, depth, mask, preset=None, steering_strength=s, generator=seeded())
        for s in (0.0, 0.3)
    ]
    assert not torch.equal(runs[0].affine_depth, runs[1].affine_depth)
    assert all(bool(torch.isfinite(run.depth).all()) for run in runs)


def test_a_step_is_equation_11(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    seen: dict[float, list[dict[str, torch.Tensor]]] = {0.0: [], 0.2: []}
    for strength, steps in seen.items():

        def keep(
            _: Any,
            i: int,
            t: torch.Tensor,
            tensors: dict[str, torch.Tensor],
            steps: list[dict[str, torch.Tensor]] = steps,
        ) -> dict[str, Any]:
            steps.append({**tensors, "t": t})
            return {}

        pipeline(
            image,
            depth,
            mask,
            preset="paper",
            num_inference_steps=2,
            steering_strength=strength,
            processing_resolution=48,
            generator=seeded(),
            callback_on_step_end=keep,
            callback_on_step_end_tensor_inputs=("latents", "predicted_x0", "steering_target"),
        )
    plain, steered = seen[0.0][0], seen[0.2][0]
    assert torch.equal(plain["predicted_x0"], steered["predicted_x0"])
    alpha_bar = pipeline.scheduler.alphas_cumprod[int(steered["t"])]
    target = steered["steering_target"][:, None].expand(-1, 3, -1, -1)
    encoded = pipeline.vae.encode(target).latent_dist.mode() * pipeline.vae.config.scaling_factor
    step = 0.2 * (1 - alpha_bar).sqrt() * (encoded - steered["predicted_x0"])
    torch.testing.assert_close(steered["latents"], plain["latents"] + step, rtol=1e-4, atol=1e-5)


def test_paper_preset_runs_the_authors_schedule(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    timesteps: list[int] = []
    sizes = set()

    def keep(_: Any, i: int, t: torch.Tensor, tensors: dict[str, torch.Tensor]) -> dict[str, Any]:
        timesteps.append(int(t))
        sizes.add(tuple(tensors["latents"].shape))
        return {}

    own = pipeline.scheduler
    pipeline(image, depth, mask, preset="paper", generator=seeded(), callback_on_step_end=keep)
    assert timesteps == list(range(981, 0, -20))
    assert sizes == {(1, 4, 8, 11)}  # the image's own size, padded to multiples of 8
    assert pipeline.scheduler is own


@pytest.mark.parametrize("preset", ["default", "fast"])
def test_our_presets_keep_measurements_and_are_positive(
    pipeline_with_encoder: SteeredMarigoldPipeline, preset: str
) -> None:
    image, _, mask = frame()
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    depth = 1 + x / WIDTH + 0.3 * torch.sin(y / 10)
    answer = pipeline_with_encoder(image, depth, mask, preset=preset, generator=seeded())
    assert isinstance(answer, DepthCompletion)
    trusted = answer.trusted[0]
    assert torch.equal(answer.depth[0][trusted], depth[trusted])
    assert trusted.sum() / mask.sum() > 0.95
    assert answer.depth.shape == (1, HEIGHT, WIDTH)
    assert bool((answer.depth > 0).all())
    assert answer.uncertainty is not None
    assert bool((answer.uncertainty >= 0).all())


def test_ensemble_is_the_median_and_its_deviation(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    latents = torch.randn(3, 4, 5, 6, generator=seeded())
    alone = [pipeline(image, depth, mask, preset=None, latents=x[None]).depth for x in latents]
    answer = pipeline(image, depth, mask, preset=None, ensemble_size=3, latents=latents)
    members = torch.cat(alone)
    median = members.median(dim=0).values
    torch.testing.assert_close(answer.depth[0], median, rtol=1e-4, atol=1e-4)
    deviation = (members - median).abs().median(dim=0).values
    assert answer.uncertainty is not None
    torch.testing.assert_close(answer.uncertainty[0], deviation, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("preset", [None, "default"])
def test_a_batch_gives_what_its_images_give_alone(
    pipeline: SteeredMarigoldPipeline, preset: str | None
) -> None:
    frames = [frame(0), frame(1, share=0.02)]
    alone = [
        pipeline(image, depth, mask, preset=preset, generator=seeded(i)).depth
        for i, (image, depth, mask) in enumerate(frames)
    ]
    images, depths, masks = zip(*frames, strict=True)
    together = pipeline(
        list(images),
        torch.stack(depths),
        torch.stack(masks),
        preset=preset,
        generator=[seeded(0), seeded(1)],
    )
    torch.testing.assert_close(together.depth, torch.cat(alone), rtol=1e-3, atol=1e-3)


def test_anchors_do_not_shift_the_noise_stream(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    states = []
    for anchors in ("fixed", "redraw"):
        generator = seeded()
        pipeline(
            image,
            depth,
            mask,
            preset="paper",
            anchors=anchors,
            num_inference_steps=2,
            generator=generator,
        )
        states.append(generator.get_state())
    assert torch.equal(*states)


def test_same_seed_same_answer(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    runs = [pipeline(image, depth, mask, generator=seeded(7)).depth for _ in range(2)]
    assert torch.equal(*runs)


def test_callback_may_replace_the_latents(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    zero = {"latents": torch.zeros(1, 4, 5, 6)}
    answers = [
        pipeline(
            image,
            depth,
            mask,
            preset=None,
            generator=seeded(seed),
            callback_on_step_end=lambda *_: zero,
        ).affine_depth
        for seed in (0, 1)
    ]
    assert torch.equal(*answers)


def test_unknown_callback_tensors_are_named(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    with pytest.raises(InputError, match="prompt_embeds"):
        pipeline(image, depth, mask, callback_on_step_end_tensor_inputs=["prompt_embeds"])


def test_without_measurements_depth_is_relative(pipeline: SteeredMarigoldPipeline) -> None:
    answer = pipeline(frame()[0], generator=seeded())
    assert not answer.metric
    assert answer.scale is None
    assert not answer.measured.any()
    assert 0 <= answer.depth.min() <= answer.depth.max() <= 1


def test_output_forms(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    arrays = pipeline(image, depth, mask, preset=None, generator=seeded(), output_type="np")
    assert isinstance(arrays["depth"], np.ndarray)
    parts = pipeline(image, depth, mask, preset=None, generator=seeded(), return_dict=False)
    np.testing.assert_array_equal(parts[0].numpy(), arrays["depth"])
    with pytest.raises(InputError, match="output_type"):
        pipeline(image, depth, mask, output_type="pil")


def test_takes_pil_images_and_sparse_depth_without_a_mask(
    pipeline: SteeredMarigoldPipeline,
) -> None:
    image, depth, mask = frame()
    pixels = (image.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8)
    from_pil = pipeline(
        Image.fromarray(pixels), torch.where(mask, depth, torch.nan), generator=seeded()
    )
    rounded = torch.from_numpy(pixels).permute(2, 0, 1).float() / 255
    assert torch.equal(from_pil.measured[0], mask)
    expected = pipeline(rounded, depth, mask, generator=seeded())
    torch.testing.assert_close(from_pil.depth, expected.depth, rtol=1e-3, atol=1e-3)


def test_input_that_does_not_fit(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    with pytest.raises(SizeMismatchError, match="`sparse_depth` is"):
        pipeline(image, depth[:-1], mask[:-1])
    with pytest.raises(NoMeasurementsError, match="no valid measurement"):
        pipeline(image, depth, torch.zeros_like(mask))
    with pytest.raises(InputError, match="finite and positive"):
        pipeline(image, -depth, mask)
    with pytest.raises(InputError, match="unknown preset"):
        pipeline(image, depth, mask, preset="best")
    with pytest.raises(InputError, match="one an image"):
        pipeline(image, depth, mask, generator=[seeded(), seeded()])


def test_reduced_precision(pipeline: SteeredMarigoldPipeline) -> None:
    pipeline.to(torch.bfloat16)
    answer = pipeline(*frame(), generator=seeded(), sensor_noise=SensorNoise(metres=0.02))
    assert answer.depth.dtype == torch.float32
    assert bool(torch.isfinite(answer.depth).all())


@pytest.mark.parametrize("preset", list(PRESETS))
def test_saves_and_loads_with_its_image_encoder(
    pipeline_with_encoder: SteeredMarigoldPipeline, preset: str, tmp_path: Path
) -> None:
    pipeline_with_encoder.save_pretrained(tmp_path / "saved")
    loaded = SteeredMarigoldPipeline.from_pretrained(
        tmp_path / "saved", dtype=torch.float32, use_safetensors=True
    )
    loaded.set_progress_bar_config(disable=True)
    answers = [
        p(*frame(), preset=preset, num_inference_steps=2, generator=seeded()).depth
        for p in (pipeline_with_encoder, loaded)
    ]
    # memory that is aligned otherwise may be summed in another order, which edges amplify
    torch.testing.assert_close(*answers, rtol=1e-3, atol=1e-3)


def test_offload_order_names_every_model(pipeline_with_encoder: SteeredMarigoldPipeline) -> None:
    pipeline_with_encoder.register_modules(steering_vae=tiny_steering_vae())
    order = SteeredMarigoldPipeline.model_cpu_offload_seq.split("->")
    models = {
        k for k, v in pipeline_with_encoder.components.items() if isinstance(v, torch.nn.Module)
    }
    assert set(order) == models
    assert order.index("text_encoder") < order.index("unet") < order.index("vae")


def test_steering_through_a_tiny_vae_leaves_the_vae_alone(
    pipeline: SteeredMarigoldPipeline,
) -> None:
    image, depth, mask = frame()
    pipeline.register_modules(steering_vae=tiny_steering_vae())
    calls: list[str] = []

    def counted(name: str) -> None:
        original = getattr(pipeline.vae, name)

        def call(*args: Any, **kwargs: Any) -> Any:
            calls.append(name)
            return original(*args, **kwargs)

        setattr(pipeline.vae, name, call)

    counted("encode")
    counted("decode")
    pipeline(
        image, depth, mask, preset="paper", num_inference_steps=3, steering_codec="tiny",
        generator=seeded(),
    )  # fmt: skip
    assert calls == ["encode", "decode"]  # the image, and the answer


def test_a_tiny_codec_that_is_not_there_is_named(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    with pytest.raises(InputError, match="steering_vae"):
        pipeline(image, depth, mask, preset="paper", steering_codec="tiny")


def test_the_record_counts_exact_and_linear_steps(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    for codec in ("exact", "linear"):
        answer = pipeline(
            image, depth, mask, preset="paper", num_inference_steps=6, steering_codec=codec,
            generator=seeded(),
        )  # fmt: skip
        assert answer.exact_codec_steps + answer.linear_codec_steps == 6
        assert answer.exact_codec_steps >= 2
        assert codec == "linear" or answer.linear_codec_steps == 0
    unsteered = pipeline(image, depth, mask, preset=None)
    assert (unsteered.exact_codec_steps, unsteered.linear_codec_steps) == (0, 0)


def forbid_networks(pipeline: SteeredMarigoldPipeline) -> None:
    """From now on every network of a pipeline fails the test that calls it."""

    def called(*args: Any, **kwargs: Any) -> Any:
        raise AssertionError("a network ran")

    for model in pipeline.components.values():
        if isinstance(model, torch.nn.Module):
            for module in model.modules():
                module.register_forward_pre_hook(called)
    pipeline.vae.encode = pipeline.vae.decode = called


LATENTS = torch.zeros(1, 4, 5, 6)
WRONG_CALLS: dict[str, tuple[dict[str, Any], str]] = {
    "shape of latents": ({"latents": LATENTS[..., :5]}, r"`latents` is \[1, 4, 5, 5\]"),
    "number of latents": (
        {"latents": LATENTS, "ensemble_size": 3},
        r"`latents` .* must be \[3, 4, 5, 6\]",
    ),
    "shape of previous latents": (
        {"previous_latents": LATENTS[:, :3]},
        r"`previous_latents` is \[1, 3, 5, 6\]",
    ),
    "restart of nothing": ({"previous_latents": LATENTS, "restart": 0.0}, "`restart` is 0"),
    "restart of more than all": ({"previous_latents": LATENTS, "restart": 1.5}, "`restart` is 1.5"),
    "size of confidence": (
        {"confidence": torch.ones(HEIGHT, WIDTH - 1)},
        rf"`confidence` is .*asks for \[1, {HEIGHT}, {WIDTH}\]",
    ),
    "confidence of per cent": (
        {"confidence": 100 * torch.ones(HEIGHT, WIDTH)},
        r"`confidence` must lie in 0\.\.1",
    ),
    "confidence that is no number": (
        {"confidence": torch.full((HEIGHT, WIDTH), torch.nan)},
        r"`confidence` must lie in 0\.\.1",
    ),
    "callback's tensors": (
        {"callback_on_step_end_tensor_inputs": ["latents", "prompt_embeds"]},
        "`callback_on_step_end_tensor_inputs` has .*prompt_embeds",
    ),
    "output type": ({"output_type": "pil"}, "`output_type` is 'pil'"),
    "no codec for steering": (
        {"steering_codec": "tiny", "steering_strength": 0.1},
        "`steering_codec='tiny'` needs a checkpoint with a steering_vae",
    ),
    "no steps": ({"num_inference_steps": 0}, "`num_inference_steps` is 0: it must be at least 1"),
    "more steps than there are": ({"num_inference_steps": 1001}, "`num_inference_steps` is 1001"),
    "preset": ({"preset": "best"}, "unknown preset 'best'"),
    "generators": ({"generator": [seeded(), seeded()]}, "`generator` is a list of 2 for 1 images"),
    "measurements of another size": (
        {"sparse_depth": torch.ones(HEIGHT, WIDTH - 1)},
        "`sparse_depth` is",
    ),
    "mask of another size": (
        {"valid_mask": torch.ones(HEIGHT - 1, WIDTH, dtype=torch.bool)},
        "`valid_mask` is",
    ),
    "negative depth": ({"sparse_depth": -torch.ones(HEIGHT, WIDTH)}, "finite and positive"),
    "nothing measured": (
        {"valid_mask": torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)},
        "no valid measurement for image 0",
    ),
}


@pytest.mark.parametrize(("arguments", "problem"), WRONG_CALLS.values(), ids=WRONG_CALLS.keys())
@pytest.mark.parametrize("preset", [None, "default", "paper"])
def test_a_wrong_call_is_refused_before_any_network_runs(
    pipeline: SteeredMarigoldPipeline, preset: str | None, arguments: dict[str, Any], problem: str
) -> None:
    image, depth, mask = frame()
    forbid_networks(pipeline)
    right: dict[str, Any] = {"sparse_depth": depth, "valid_mask": mask, "preset": preset}
    sizes: dict[str, Any] = {"processing_resolution": 48, "ensemble_size": 1, "mirror": False}
    with pytest.raises(InputError, match=problem):
        pipeline(image, **right | sizes | arguments)
    with pytest.raises(AssertionError, match="a network ran"):
        pipeline(image, **right | sizes)


@pytest.mark.parametrize(
    "scheduler",
    ["UniPCMultistepScheduler", "DPMSolverMultistepScheduler", "EulerDiscreteScheduler"],
)
def test_a_scheduler_without_a_clean_estimate_is_refused_before_any_network_runs(
    pipeline: SteeredMarigoldPipeline, scheduler: str
) -> None:
    pipeline.scheduler = getattr(diffusers, scheduler).from_config(pipeline.scheduler.config)
    image, depth, mask = frame()
    forbid_networks(pipeline)
    for preset in (None, "default"):
        with pytest.raises(InputError, match=f"{scheduler}.*use DDIMScheduler, DDPMS"):
            pipeline(image, depth, mask, preset=preset)


def test_the_answer_carries_its_latents_if_asked(pipeline: SteeredMarigoldPipeline) -> None:
    image, depth, mask = frame()
    arguments: dict[str, Any] = {"preset": None, "ensemble_size": 3}
    plain = pipeline(image, depth, mask, generator=seeded(), **arguments)
    answer = pipeline(image, depth, mask, generator=seeded(), output_latents=True, **arguments)
    assert plain.latents is None
    assert answer.latents.shape == (3, 4, 5, 6)
    assert torch.equal(answer.depth, plain.depth)
    last: list[torch.Tensor] = []

    def keep(pipe: Any, i: int, t: torch.Tensor, tensors: dict[str, Any]) -> dict[str, Any]:
        last[:] = [tensors["latents"]]
        return {}

    pipeline(image, depth, mask, generator=seeded(), callback_on_step_end=keep, **arguments)
    assert torch.equal(answer.latents, last[0])
    arrays = pipeline(
        image, depth, mask, generator=seeded(), output_latents=True, output_type="np", **arguments
    )
    np.testing.assert_array_equal(arrays["latents"], answer.latents.numpy())


@pytest.mark.parametrize("scheduler", ["DDPMScheduler", "DDIMScheduler", "LCMScheduler"])
def test_a_restart_runs_the_last_steps_from_the_previous_latents(
    pipeline: SteeredMarigoldPipeline, scheduler: str
) -> None:
    pipeline.scheduler = getattr(diffusers, scheduler).from_config(pipeline.scheduler.config)
    image, depth, mask = frame()
    seen: list[int] = []

    def watch(pipe: Any, i: int, t: torch.Tensor, tensors: dict[str, Any]) -> dict[str, Any]:
        seen.append(int(t))
        return {}

    previous = torch.zeros(1, 4, 5, 6)
    pipeline(
        image, depth, mask, preset=None, num_inference_steps=4, previous_latents=previous,
        restart=0.5, callback_on_step_end=watch, generator=seeded(),
    )  # fmt: skip
    pipeline.scheduler.set_timesteps(4)
    assert seen == pipeline.scheduler.timesteps.tolist()[2:]
    with pytest.raises(InputError, match="restart"):
        pipeline(image, depth, mask, preset=None, previous_latents=previous, restart=0.0)
    with pytest.raises(InputError, match=r"`previous_latents` is \[2, 4, 5, 6\]"):
        pipeline(image, depth, mask, preset=None, previous_latents=previous.repeat(2, 1, 1, 1))


def test_only_hooked_entry_points_are_called(pipeline: SteeredMarigoldPipeline) -> None:
    """Offloading moves a model when its forward (or the VAE's encode or decode) is called."""
    inside: list[bool] = []
    entered = {"vae": 0}
    for part in (pipeline.vae.encoder, pipeline.vae.decoder):
        part.register_forward_pre_hook(lambda *_: inside.append(entered["vae"] > 0))
    for name in ("encode", "decode"):
        method = getattr(pipeline.vae, name)

        def hooked(*args: Any, method: Any = method, **kwargs: Any) -> Any:
            entered["vae"] += 1
            try:
                return method(*args, **kwargs)
            finally:
                entered["vae"] -= 1

        setattr(pipeline.vae, name, hooked)
    pipeline(*frame(), preset=None, steering_strength=0.1, generator=seeded())
    assert len(inside) == 1 + 2 * 3 + 1
    assert all(inside)


@pytest.mark.parametrize("steering_strength", [0.0, 0.3])
def test_a_mirrored_ensemble_answers_a_mirrored_frame_with_the_mirror_image(
    pipeline: SteeredMarigoldPipeline, steering_strength: float
) -> None:
    image, depth, mask = frame()
    noise = torch.randn(2, 4, 5, 6, generator=seeded())
    arguments: dict[str, Any] = {
        "preset": None, "mirror": True, "ensemble_size": 2, "anchor_fraction": 0.0,
        "steering_strength": steering_strength,
    }  # fmt: skip
    answer = pipeline(image, depth, mask, latents=noise, **arguments)
    mirrored = pipeline(image.flip(-1), depth.flip(-1), mask.flip(-1), latents=noise.flip(0),
                        **arguments)  # fmt: skip
    torch.testing.assert_close(answer.depth, mirrored.depth.flip(-1), rtol=1e-3, atol=1e-3)
    single = pipeline(image, depth, mask, latents=noise, **arguments | {"mirror": False})
    assert not torch.allclose(answer.depth, single.depth, atol=1e-3)


def test_a_checkpoint_that_continues_the_known_is_told_what_was_measured(
    pipeline: SteeredMarigoldPipeline,
) -> None:
    image, _, mask = frame()
    depth = 1 + torch.arange(WIDTH) / WIDTH + torch.zeros(HEIGHT, 1)  # nothing to distrust
    mask[:, :20] = True
    mask[:, 30:] = False
    inputs: list[torch.Tensor] = []
    forward = pipeline.unet.forward

    def watched(sample: torch.Tensor, *args: Any, **kwargs: Any) -> Any:
        inputs.append(sample[:, -4:])
        return forward(sample, *args, **kwargs)

    pipeline.unet.forward = watched
    noise = torch.randn(2, 4, 5, 6, generator=seeded())
    arguments: dict[str, Any] = {"preset": "default", "num_inference_steps": 1, "latents": noise}
    pipeline(image, depth, mask, **arguments)
    assert len(inputs) == 1  # other checkpoints know nothing of it
    pipeline.register_to_config(continues_known=True)
    inputs.clear()
    pipeline(image, depth, mask, **arguments)
    first, second = inputs
    same = (first == second).all(dim=1)
    assert same[0, :, 0].sum() <= 1  # the plain view is told its left, where it is believed
    assert same[0, :, -1].all()
    assert not same[1, :, -1].all()  # the mirrored one its right
    assert same[1, :, 0].all()


def test_what_a_checkpoint_continues_survives_saving(
    pipeline: SteeredMarigoldPipeline, tmp_path: Path
) -> None:
    pipeline.register_to_config(continues_known=True)
    pipeline.save_pretrained(tmp_path)
    assert SteeredMarigoldPipeline.from_pretrained(tmp_path).config.continues_known


@pytest.mark.parametrize("size", [(1, 1), (24, 1), (1, 24), (2, 2), (33, 3)])
def test_thin_images(pipeline_with_encoder: SteeredMarigoldPipeline, size: tuple[int, int]) -> None:
    depth = torch.full(size, 2.0)
    answer = pipeline_with_encoder(torch.zeros(3, *size), depth, preset="fast")
    torch.testing.assert_close(answer.depth[0], depth)


def test_images_that_are_too_thin_are_refused(pipeline: SteeredMarigoldPipeline) -> None:
    with pytest.raises(InputError, match="aspect ratio"):
        pipeline(torch.zeros(3, 1000, 3), torch.ones(1000, 3))
