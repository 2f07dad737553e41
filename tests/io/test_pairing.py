"""Images find their depth maps by name."""

import random
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steered_marigold.errors import InputError
from steered_marigold.io.pairing import Pairing, pair_files


def _names(pairing: Pairing) -> list[tuple[str, str]]:
    return list(pairing.pairs.items())


@pytest.mark.parametrize(
    ("images", "depths", "rule"),
    [
        (["a.jpg", "b.jpg"], ["a.png", "b.npy"], "equal stems"),
        (["1_color.jpg", "2_color.jpg"], ["1_depth.png", "2_depth.png"], "color and depth"),
        (["a_rgb.png", "b_rgb.png"], ["a_d.png", "b_d.png"], "color and depth"),
        (["rgb0007.png", "rgb0008.png"], ["depth0007.png", "depth0008.png"], "color and depth"),
        (["frame-000001.color.jpg"], ["frame-000001.depth.png"], "color and depth"),
        (["ColorImage_01.png"], ["DepthImage_01.png"], "color and depth"),
        (["a_color.png"], ["a_aligned_depth_to_color.png"], "color and depth"),
        (["x_sync_image_0005_image_02.png"], ["x_sync_velodyne_raw_0005_image_02.png"],
         "color and depth"),
        (["left_1.png", "left_02.png"], ["scan1.npy", "scan2.npy"], "last number"),
        (["000001_cam0.png", "000002_cam0.png"], ["1_lidar2.npy", "2_lidar2.npy"], "first number"),
        (["1700000000123456789.png"], ["1700000000133456789.png"], "time stamps"),
        (["img_1700000000.100.png"], ["dep_1700000000.110.png"], "time stamps"),
        (["1700000000123.png", "1700000001123.png"], ["1700000000120.npy", "1700000001130.npy"],
         "time stamps"),
    ],
)  # fmt: skip
def test_each_rule(images: list[str], depths: list[str], rule: str) -> None:
    pairing = pair_files(images, depths)
    assert rule in pairing.rule
    assert _names(pairing) == list(zip(sorted(images), sorted(depths), strict=True)) or (
        set(_names(pairing)) == set(zip(images, depths, strict=True))
    )
    assert pairing.unpaired == ([], [])


def test_what_has_no_partner_is_told() -> None:
    pairing = pair_files(["a.jpg", "b.jpg"], ["b.png", "c.png"])
    assert _names(pairing) == [("b.jpg", "b.png")]
    assert pairing.unpaired == (["a.jpg"], ["c.png"])


def test_the_rule_that_pairs_most_wins() -> None:
    images = ["10.00.png", "20.00.png", "30.00.png"]
    depths = ["10.00.png", "20.01.png", "30.01.png"]
    assert len(pair_files(images, depths).pairs) == 3
    assert "time stamps" in pair_files(images, depths).rule


@pytest.mark.parametrize(
    ("images", "depths"),
    [
        (["0.jpg", "0.png"], ["0.npy"]),
        (["a.jpg"], ["a.png", "a.npy"]),
        (["left_1.png", "right_1.png"], ["depth1.png"]),
    ],
)
def test_several_candidates_are_listed(images: list[str], depths: list[str]) -> None:
    with pytest.raises(InputError, match="several ways") as caught:
        pair_files(images, depths)
    assert all(name in str(caught.value) for name in images + depths)


def test_one_folder_for_both() -> None:
    names = ["0_color.png", "0_depth.png", "1_color.png", "1_depth.png"]
    pairing = pair_files(names, names, one_folder=True)
    assert _names(pairing) == [("0_color.png", "0_depth.png"), ("1_color.png", "1_depth.png")]
    plain = ["0.jpg", "0_depth.png"]
    pairing = pair_files(plain, ["0_depth.png"], one_folder=True)
    assert _names(pairing) == [("0.jpg", "0_depth.png")]
    for same in (["0.png", "1.png"], ["0_depth.png"]):
        with pytest.raises(InputError, match="same files are given"):
            pair_files(same, same, one_folder=True)


def test_stamps_take_the_closest_and_each_file_once() -> None:
    """As TUM's associate.py, written plainly."""
    generator = random.Random(0)
    images = [f"{1305031229 + generator.random() * 4:.6f}.png" for _ in range(60)]
    depths = [f"{1305031229 + generator.random() * 4:.6f}.png" for _ in range(70)]
    slop = 0.05
    candidates = sorted((abs(float(a[:-4]) - float(b[:-4])), a, b) for a in images for b in depths)
    expected, used = [], set[str]()
    for gap, image, depth in candidates:
        if gap <= slop and f"i{image}" not in used and f"d{depth}" not in used:
            used |= {f"i{image}", f"d{depth}"}
            expected.append((image, depth))
    assert _names(pair_files(images, depths, slop=slop)) == sorted(expected)


@given(
    times=st.lists(st.integers(0, 3000), min_size=1, max_size=40, unique=True),
    jitter=st.integers(0, 9),
)
def test_no_pair_is_farther_apart_than_the_slop(times: list[int], jitter: int) -> None:
    images = [f"{100 + t / 100:.3f}.png" for t in times]
    depths = [f"{100 + t / 100 + jitter / 1000:.3f}.npy" for t in times]
    pairing = pair_files(images, depths, slop=0.009)
    assert all(
        abs(float(Path(image).stem) - float(Path(depth).stem)) <= 0.0091
        for image, depth in pairing.pairs.items()
    )
    assert len(set(pairing.pairs.values())) == len(pairing.pairs)


def test_too_small_a_slop_names_the_gap() -> None:
    with pytest.raises(InputError, match=r"0\.3 s apart.*`slop`.*`associations`"):
        pair_files(["10.000000.png"], ["10.300000.png"])
    with pytest.raises(InputError, match="`slop` is a time"):
        pair_files(["10.0.png"], ["10.0.png"], slop=-1.0)


def test_association_files(tmp_path: Path) -> None:
    file = tmp_path / "associations.txt"
    file.write_text("# TUM\n1.5 rgb/1.5.png 1.7 depth/1.7.png\n2.5 rgb/2.5.png 2.7 depth/2.7.png\n")
    images, depths = ["1.5.png", "2.5.png", "9.png"], ["1.7.png", "2.7.png"]
    pairing = pair_files(images, depths, associations=file)
    assert _names(pairing) == [("1.5.png", "1.7.png"), ("2.5.png", "2.7.png")]
    assert pairing.rule == "the association file"
    assert pairing.unpaired == (["9.png"], [])
    file.write_text("1.7 depth/1.7.png 1.5 rgb/1.5.png\n")
    assert _names(pair_files(images, depths, associations=file)) == [("1.5.png", "1.7.png")]
    file.write_text("1.5.png 2.7.png\n")
    assert _names(pair_files(images, depths, associations=file)) == [("1.5.png", "2.7.png")]
    for text, problem in (("a b c\n", "each line"), ("x.png y.png\n", "none of the given")):
        file.write_text(text)
        with pytest.raises(InputError, match=problem):
            pair_files(images, depths, associations=file)


def test_lists_of_stamps(tmp_path: Path) -> None:
    (tmp_path / "rgb.txt").write_text("# color images\n1.500 rgb/a.png\n2.500 rgb/b.png\n")
    (tmp_path / "depth.txt").write_text("2.510 depth/x.png\n1.490 depth/y.png\n")
    pairing = pair_files(["a.png", "b.png"], ["x.png", "y.png"], associations=tmp_path)
    assert _names(pairing) == [("a.png", "y.png"), ("b.png", "x.png")]


def test_nothing_in_common() -> None:
    with pytest.raises(InputError, match=r"foo\.jpg and bar\.png.*`associations`"):
        pair_files(["foo.jpg"], ["bar.png"])
    with pytest.raises(InputError, match="no depth maps"):
        pair_files(["foo.jpg"], [])


@pytest.mark.parametrize("count", [10_000, pytest.param(100_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("stamps", [False, True])
def test_many_names_take_seconds(count: int, stamps: bool) -> None:
    images = [f"{t / 30:.6f}.jpg" if stamps else f"{t:06d}.jpg" for t in range(count)]
    depths = [f"{t / 30 + 0.011:.6f}.png" if stamps else f"{t:06d}.png" for t in range(count)]
    started = time.process_time()
    assert len(pair_files(images, depths).pairs) == count
    assert time.process_time() - started < count / 2000  # about 5 s for 100 000 on a free core
