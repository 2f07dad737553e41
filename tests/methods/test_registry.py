import subprocess
import sys
from pathlib import Path

import pytest

from steered_marigold.diffusion.settings import PRESETS
from steered_marigold.errors import CheckpointError, InputError
from steered_marigold.methods.completer import DepthCompleter
from steered_marigold.methods.inpainting import OpenCvInpainter
from steered_marigold.methods.ip_basic import IpBasicCompleter
from steered_marigold.methods.registry import METHODS, create_method, method_label
from steered_marigold.methods.steered import SteeredCompleter

CLASSICAL = ("nearest", "linear", "ip-basic", "telea", "navier-stokes", "colorization")


@pytest.mark.parametrize("name", CLASSICAL)
def test_creates_each_classical_method_under_its_name(name: str) -> None:
    method = create_method(name)
    assert name in METHODS
    assert isinstance(method, DepthCompleter)
    assert method.name == name


def test_settings_take_the_type_of_the_argument() -> None:
    ip_basic = create_method("ip-basic@max_depth=20")
    assert isinstance(ip_basic, IpBasicCompleter)
    assert ip_basic.max_depth == 20.0
    assert isinstance(ip_basic.max_depth, float)
    telea = create_method("telea@radius_px=5")
    assert isinstance(telea, OpenCvInpainter)
    assert telea.radius_px == 5.0


def test_flags_are_true_or_false() -> None:
    steered = create_method("default@mirror=false,ensemble_size=1")
    assert isinstance(steered, SteeredCompleter)
    with pytest.raises(InputError, match=r"mirror='no' is no bool"):
        create_method("default@mirror=no")


def test_an_unknown_method_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"'bilinear'.*nearest, linear, .*completionformer"):
        create_method("bilinear")


@pytest.mark.parametrize("name", ["ip-basic@radius=3", "ip-basic@checkpoint=x", "ip-basic@name=x"])
def test_an_unknown_setting_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError, match=r"ip-basic has no setting .* it has: max_depth$"):
        create_method(name)


def test_what_a_name_implies_is_no_setting() -> None:
    with pytest.raises(InputError, match=r"telea has no setting 'algorithm'"):
        create_method("telea@algorithm=navier-stokes")


@pytest.mark.parametrize("value", ["far", "", "1m"])
def test_a_value_of_another_type_is_refused(value: str) -> None:
    with pytest.raises(InputError, match=r"max_depth=.* float"):
        create_method(f"ip-basic@max_depth={value}")


@pytest.mark.parametrize("name", ["bpnet", "completionformer"])
def test_a_learned_baseline_needs_its_own_weights(name: str, tmp_path: Path) -> None:
    other = {"bpnet": "completionformer", "completionformer": "bpnet"}[name]
    with pytest.raises(CheckpointError, match=rf"{name} needs .*{name}.*baselines\.md"):
        create_method(name, weights={other: tmp_path / "other.pth"})
    with pytest.raises(CheckpointError, match=r"absent\.pth"):
        create_method(name, weights={name: tmp_path / "absent.pth"})


def test_a_literal_setting_accepts_only_its_values(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"trained_on='indoor' .*nyuv2.*kitti"):
        create_method("bpnet@trained_on=indoor", weights={"bpnet": tmp_path / "file.pth"})


def test_importing_the_registry_imports_no_method() -> None:
    code = (
        "import sys, steered_marigold.methods.registry;"
        "print([m for m in ('cv2', 'scipy', 'diffusers', 'transformers') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]", result.stderr


@pytest.mark.parametrize(
    "name", ["marigold", "default", "fast", "paper", "paper-minmax", "marigold-dc"]
)
def test_a_diffusion_method_takes_settings_and_a_checkpoint(name: str, tmp_path: Path) -> None:
    settings = "num_inference_steps, .*ensemble_size, .*processing_resolution"
    with pytest.raises(InputError, match=rf"{name} has no setting 'speed'; it has: .*{settings}"):
        create_method(f"{name}@speed=1")
    with pytest.raises(CheckpointError, match=r"model_index\.json"):
        create_method(f"{name}@num_inference_steps=2", checkpoint=str(tmp_path))


@pytest.mark.parametrize("name", ["marigold", "default", "fast", "paper", "paper-minmax"])
def test_a_preset_has_its_own_name_and_says_if_it_steers(name: str) -> None:
    assert name in METHODS
    method = create_method(name, dtype="float32")
    assert (method.name, method.steers) == (name, name.startswith("paper"))
    assert method.describe()["steers"] == method.steers
    assert create_method(f"{name}@steering_strength=0.3", dtype="float32").steers


@pytest.mark.parametrize(
    ("former", "label"),
    [
        ("steered", "default"),
        ("steered:default", "default"),
        ("steered:fast", "fast"),
        ("steered:paper", "paper"),
        ("steered:paper@steering_strength=0.2", "paper@steering_strength=0.2"),
    ],
)
def test_former_names_lead_to_the_new_ones(former: str, label: str) -> None:
    assert method_label(former) == label
    assert method_label(label) == label
    with pytest.raises(InputError, match=rf"^{label.partition('@')[0]} has no setting 'speed'"):
        create_method(f"{former.partition('@')[0]}@speed=1")


def test_the_authors_uniform_run_is_the_papers_but_for_its_alignment() -> None:
    paper, minmax = PRESETS["paper"].knobs, PRESETS["paper-minmax"].knobs
    assert minmax == paper | {"condition_alignment": "minmax"}
    assert paper["condition_alignment"] == "least_squares"
