"""The numbers behind `python -m training evaluate`, and the command on two rendered frames."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.stats import spearmanr
from typer.testing import CliRunner

from benchmarks.measuring import Timing
from steered_marigold.core.frame import make_frame
from steered_marigold.datasets.sample import Sample
from steered_marigold.errors import InputError
from steered_marigold.evaluation.protocols import PreparedFrame, Protocol, prepare
from training.__main__ import app
from training.evaluation.calibration import fitted, sample_errors
from training.evaluation.coding import steepest_window
from training.evaluation.denoising import centre_patch, ring, to_pixels
from training.evaluation.drift import scale_and_shift
from training.evaluation.report import add_part, read_figures
from training.evaluation.run import PARTS
from training.evaluation.speed import milliseconds
from training.evaluation.subject import (
    Findings,
    NativeFrame,
    Subject,
    evenly_spaced,
    mean_row,
    split_frames,
)


@pytest.fixture(scope="module")
def nyuv2(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of the report split, as files: a box on a sloping floor."""
    folder = tmp_path_factory.mktemp("nyuv2")
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[:480, :640]
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
    for frame_id in split_frames("report", 2):
        depth = 5000 - 6 * rows - 1500 * (abs(columns - rng.integers(200, 400)) < 80)
        Image.fromarray(depth.astype(np.uint16)).save(folder / "depth" / f"{frame_id}.png")
        image = np.repeat((depth[..., None] // 20).astype(np.uint8), 3, axis=2)
        Image.fromarray(image).save(folder / "rgb" / f"{frame_id}.jpg")
    return folder


@pytest.fixture
def frame() -> PreparedFrame:
    """A frame whose every pixel is measured."""
    depth = 1 + 4 * torch.rand(448, 608, generator=torch.Generator().manual_seed(0))
    known = torch.ones_like(depth, dtype=torch.bool)
    frame = make_frame(torch.zeros(448, 608, 3), id="0")
    sample = Sample(frame=frame, metric_depth=depth, metric_mask=known)
    return prepare(sample, Protocol(kind="paper-uniform"), seed=0)


def run(nyuv2: Path, output: Path, *options: str) -> None:
    """The command on the two frames."""
    arguments = ["evaluate", "--nyuv2", str(nyuv2), "--limit", "2", "--output", str(output)]
    result = CliRunner().invoke(app, [*arguments, *options], catch_exceptions=False)
    assert result.exit_code == 0


def test_frames_are_spread_over_the_split() -> None:
    assert evenly_spaced(list("abcde"), 3) == ("a", "c", "e")
    assert evenly_spaced(list("ab"), 3) == evenly_spaced(list("ab"), None) == ("a", "b")
    assert len(split_frames("report", None)) == 47


def test_ring_is_what_is_near_the_patch_and_not_in_it() -> None:
    patch = centre_patch((30, 40))
    around = ring(patch, 4)
    assert patch.sum() == 10 * 12
    assert around.sum() == 18 * 20 - 10 * 12
    assert not (around & patch).any()
    rows, columns = torch.nonzero(around, as_tuple=True)
    inside_rows, inside_columns = torch.nonzero(patch, as_tuple=True)
    away = torch.maximum(
        (rows[:, None] - inside_rows).abs(), (columns[:, None] - inside_columns).abs()
    )
    assert away.min(dim=1).values.max() == 4
    assert to_pixels(around).shape == (1, 240, 320)
    assert to_pixels(around).sum() == 64 * around.sum()


def test_errors_of_a_native_frame() -> None:
    truth = torch.tensor([[[-1.0, 0.0, 1.0]]])
    native = NativeFrame(torch.zeros(1, 3, 1, 3), truth, low=1.0, high=3.0)
    errors = native.errors(truth + 0.5)
    assert errors["abs_error"] == pytest.approx(0.5)
    assert errors["abs_rel"] == pytest.approx((0.5 / 1 + 0.5 / 2 + 0.5 / 3) / 3)
    only_last = torch.tensor([[[False, False, True]]])
    assert native.errors(truth + 0.5, only_last)["abs_rel"] == pytest.approx(0.5 / 3)


def test_samples_that_differ_from_the_truth_by_scale_and_shift_have_no_error(
    frame: PreparedFrame,
) -> None:
    affine = torch.stack([(frame.metric_depth - 1) / 5, frame.metric_depth / 8])
    torch.testing.assert_close(fitted(affine, frame), frame.metric_depth.expand(2, -1, -1))
    errors = sample_errors(affine, frame)
    assert errors["single_rmse_m"] == pytest.approx(0, abs=1e-5)
    assert errors["mean_rmse_m"] == pytest.approx(0, abs=1e-5)


def test_samples_are_scored_as_numpy_and_scipy_do(frame: PreparedFrame) -> None:
    generator = torch.Generator().manual_seed(1)
    noise = torch.randn(3, 448, 608, generator=generator) * frame.metric_depth / 50
    affine = (frame.metric_depth - 1) / 5 + noise
    errors = sample_errors(affine, frame)
    mask = frame.shown.valid_mask.numpy()
    truth = frame.metric_depth.double().numpy()

    def fit(values: np.ndarray) -> np.ndarray:
        coefficients = np.polyfit(values[mask], truth[mask], 1)
        return np.asarray(np.polyval(coefficients, values))

    samples = affine.double().numpy()
    singles = np.stack([fit(sample) for sample in samples])
    mean = fit(samples.mean(axis=0))
    rmse = [np.sqrt(np.mean((single - truth) ** 2)) for single in singles]
    assert errors["single_rmse_m"] == pytest.approx(np.mean(rmse), rel=1e-4)
    assert errors["mean_rmse_m"] == pytest.approx(np.sqrt(np.mean((mean - truth) ** 2)), rel=1e-4)
    spread = singles.std(axis=0, ddof=1)
    expected = spearmanr(spread.ravel(), abs(mean - truth).ravel()).statistic
    assert errors["spearman"] == pytest.approx(expected, abs=1e-3)
    assert errors["spread_units"] == pytest.approx(2 * samples.std(axis=0, ddof=1).mean(), rel=1e-4)


def test_scale_and_shift_of_an_affine_change() -> None:
    values = torch.linspace(-1, 1, 12).view(1, 3, 4)
    mask = values > -0.5
    scale, shift = scale_and_shift(values, torch.where(mask, 0.5 * values - 0.25, 9.0), mask)
    assert (scale, shift) == pytest.approx((0.5, -0.25))


def test_window_holds_the_edges() -> None:
    depth = torch.zeros(60, 80)
    depth[30:40, 50:60] = 1
    y, x = steepest_window(depth, 20)
    assert 20 <= y <= 30
    assert 40 <= x <= 50


def test_times_are_in_milliseconds() -> None:
    times = milliseconds(Timing((0.002, 0.001, 0.004), peak_mib=0))
    assert times == {"median_ms": 2, "fastest_ms": 1, "slowest_ms": 4}


def test_parts_merge_and_other_weights_do_not(tmp_path: Path) -> None:
    subject = {"checkpoint": "embedded", "weights": "a"}
    for name, value in (("codec", 1.0), ("speed", 2.0), ("codec", 3.0)):
        found = Findings({"title": [mean_row([{"x": value}, {"x": value + 1}])]}, ("p.png",))
        add_part(tmp_path, subject, name, {"frames": 2}, found)
    parts = read_figures(tmp_path)["parts"]
    assert parts["codec"]["tables"] == {"title": [{"x": 3.5}]}
    assert list(parts) == ["codec", "speed"]
    assert "| 3.5 |" in (tmp_path / "figures.md").read_text()
    with pytest.raises(InputError, match="other weights"):
        add_part(tmp_path, {**subject, "weights": "b"}, "codec", {}, found)


def test_codec_part_on_the_embedded_checkpoint(nyuv2: Path, tmp_path: Path) -> None:
    run(nyuv2, tmp_path, "--parts", "codec")
    figures = json.loads((tmp_path / "figures.json").read_text())
    (row,) = next(iter(figures["parts"]["codec"]["tables"].values()))
    assert 0 < row["abs_rel"] < 0.05
    assert len(figures["weights"]) == 64
    assert (tmp_path / "codec.png").is_file()
    with pytest.raises(InputError, match="no part"):
        run(nyuv2, tmp_path, "--parts", "other")


@pytest.mark.slow
def test_every_part_on_the_embedded_checkpoint(nyuv2: Path, tmp_path: Path) -> None:
    real = tmp_path / "real"
    (frame_id,) = split_frames("report", 1)
    (real / "one").mkdir(parents=True)
    for name, suffix in (("rgb", "jpg"), ("depth", "png")):
        source = nyuv2 / name / f"{frame_id}.{suffix}"
        (real / "one" / f"{name}.{suffix}").write_bytes(source.read_bytes())
    output = tmp_path / "output"
    options = ("--steps", "1,2,3", "--samples", "2", "--real-frames", str(real))
    run(nyuv2, output, *options)
    parts = read_figures(output)["parts"]
    assert list(parts) == [part for part in PARTS if part != "kinds"]
    for part in parts.values():
        assert all((output / picture).is_file() for picture in part["pictures"])
    assert parts["sheet"]["pictures"] == ["sheet_1.png", "sheet_real_1.png"]
    _, by_timestep = next(iter(parts["denoiser"]["tables"].items()))
    assert by_timestep[-1]["abs_error"] < by_timestep[0]["abs_error"]


def test_unsteered_estimate_is_the_pipelines(nyuv2: Path, tmp_path: Path) -> None:
    """x0 from noise at the first timestep is what one step of the pipeline gives."""
    frames = split_frames("report", 2)
    subject = Subject(
        checkpoint="embedded", nyuv2=nyuv2, frames=frames, steps=(1,), samples=2, output=tmp_path
    )
    native = subject.native(frames[0])
    noise = torch.randn(1, 4, 30, 40, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        decoded = subject.estimate(noise, 999, subject.image_latents(native))
    answer = subject.pipeline(
        (native.image + 1) / 2, preset=None, num_inference_steps=1, latents=noise
    )
    torch.testing.assert_close((decoded + 1) / 2, answer.affine_depth, atol=1e-4, rtol=0)
