"""Calls are counted as they happen, and other networks' times are put in their place."""

import pytest

from benchmarks.runs import RUNS, run_pipeline, run_reference
from benchmarks.schedule import Schedule, extrapolate, observe, recorded_calls
from benchmarks.subjects import BenchmarkFrame, sample_frame
from steered_marigold.diffusion.pipeline import SteeredMarigoldPipeline
from tests.diffusion.conftest import tiny_pipeline


@pytest.fixture
def frame() -> BenchmarkFrame:
    return sample_frame(64, 48, 150)


@pytest.fixture(params=[False, True], ids=["vae", "image encoder"])
def pipeline(request: pytest.FixtureRequest) -> SteeredMarigoldPipeline:
    pipe = tiny_pipeline(with_image_encoder=request.param)
    pipe.set_progress_bar_config(disable=True)
    return pipe


def test_the_reference_decodes_and_encodes_in_each_of_50_steps(
    pipeline: SteeredMarigoldPipeline, frame: BenchmarkFrame
) -> None:
    schedule = observe(pipeline, lambda: run_reference(pipeline, frame))
    assert (schedule.image, schedule.unet) == (1, 50)
    assert (schedule.decode, schedule.encode, schedule.final) == (51, 50, 1)
    assert (schedule.approximate_decode, schedule.approximate_encode) == (0, 0)
    assert min(schedule.before_s, schedule.loop_s, schedule.after_s) > 0


def test_members_and_steered_maps_are_counted_one_by_one(
    pipeline: SteeredMarigoldPipeline, frame: BenchmarkFrame
) -> None:
    schedule = observe(
        pipeline, lambda: run_pipeline(pipeline, frame, "default, steered, exact codec")
    )
    members = schedule.final
    steered = schedule.encode + schedule.approximate_encode
    assert schedule.decode + schedule.approximate_decode - members == steered
    assert schedule.unet == steered == 3 * members


def test_networks_are_as_before_when_recording_ends(pipeline: SteeredMarigoldPipeline) -> None:
    with recorded_calls(pipeline):
        assert "forward" in vars(pipeline.unet)
    assert "forward" not in vars(pipeline.unet)
    assert not {"encode", "decode"} & vars(pipeline.vae).keys()


def test_an_image_takes_its_calls_and_what_lies_outside_the_networks() -> None:
    schedule = Schedule(
        image=1, unet=50, decode=51, encode=50, final=1, approximate_decode=0,
        approximate_encode=0, before_s=1.0, loop_s=9.0, after_s=2.0,
    )  # fmt: skip
    result = extrapolate(schedule, {"image": 8.0, "unet": 6.0, "decode": 20.0, "encode": 8.0})
    assert result.seconds == 8 + 300 + 51 * 20 + 50 * 8 + 12
    assert result.steering_share == (50 * 20 + 50 * 8 + 10) / 300


def test_runs_name_presets_that_exist(frame: BenchmarkFrame) -> None:
    pipe = tiny_pipeline()
    pipe.set_progress_bar_config(disable=True)
    for name in RUNS:
        if name != "paper":
            assert run_pipeline(pipe, frame, name) >= 0
