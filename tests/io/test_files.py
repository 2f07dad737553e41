"""Whole files or none."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.files import (
    atomic_write,
    atomic_writes,
    create_folder,
    require_file,
    require_suffix,
    require_writable,
    split_name,
    stale_temporaries,
)


@pytest.mark.parametrize("name", ["a.png", "a.b.png", "a", ".a", ".a.png", "é .PNG"])
def test_a_name_is_split_as_a_path_is(name: str) -> None:
    assert split_name(name) == (Path(name).stem, Path(name).suffix)


def test_a_write_appears_only_when_it_is_complete(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with atomic_write(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".txt"
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_a_failed_write_leaves_everything_as_it_was(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def fail_halfway() -> None:
        with atomic_write(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_halfway()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_refusal_of_the_system_is_an_input_error(tmp_path: Path) -> None:
    target = tmp_path / "missing" / "a.txt"
    with pytest.raises(InputError, match=r"a\.txt.*cannot be written"), atomic_write(target) as t:
        t.write_text("x")


def test_unwritable_targets_are_told_beforehand(tmp_path: Path) -> None:
    require_writable(tmp_path / "new.png")
    with pytest.raises(InputError, match="is a folder"):
        require_writable(tmp_path)
    with pytest.raises(InputError, match="there is no folder"):
        require_writable(tmp_path / "missing" / "new.png")


def test_folders_are_created_with_their_parents_but_not_over_files(tmp_path: Path) -> None:
    create_folder(tmp_path / "a" / "b")
    create_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="cannot be a folder"):
        create_folder(tmp_path / "file")


def test_paths_of_the_wrong_kind(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no such file"):
        require_file(tmp_path / "nothing.png")
    with pytest.raises(FileFormatError, match="is a folder"):
        require_file(tmp_path)
    assert require_suffix("A.PNG", (".png", ".npy")) == ".png"
    with pytest.raises(FileFormatError, match=r"'\.jpg'; use one of \.png, \.npy"):
        require_suffix("a.jpg", (".png", ".npy"))


def _write(targets: list[Path], *, without: int | None = None) -> None:
    with atomic_writes(targets) as temporaries:
        for index, temporary in enumerate(temporaries):
            if index != without:
                temporary.write_text("new")


def test_several_files_appear_together(tmp_path: Path) -> None:
    targets = [tmp_path / "a.txt", tmp_path / "b.json"]
    targets[0].write_text("old")
    with atomic_writes(targets) as temporaries:
        assert [path.suffix for path in temporaries] == [".txt", ".json"]
        for temporary in temporaries:
            temporary.write_text(f"new {temporary.suffix}")
        assert targets[0].read_text() == "old"
        assert not targets[1].exists()
    assert [path.read_text() for path in targets] == ["new .txt", "new .json"]
    assert sorted(tmp_path.iterdir()) == targets


@pytest.mark.parametrize("broken", [0, 1, 2])
def test_none_of_several_files_appears_where_one_fails(tmp_path: Path, broken: int) -> None:
    """One is never written, or cannot be renamed because a folder has its name."""
    targets = [tmp_path / name for name in ("a.txt", "b.txt", "c.txt")]
    targets[0].write_text("old a")
    targets[2].write_text("old c")
    before = {path: path.read_text() for path in targets if path.exists()}
    with pytest.raises(InputError, match=rf"{targets[broken].name}: cannot be written"):
        _write(targets, without=broken)
    assert {path: path.read_text() for path in tmp_path.iterdir()} == before

    in_the_way = [*targets, tmp_path / "folder"]
    (tmp_path / "folder" / "inside").mkdir(parents=True)
    with pytest.raises(InputError, match="folder: cannot be written"):
        _write(in_the_way)
    assert {path: path.read_text() for path in tmp_path.iterdir() if path.is_file()} == before


def test_an_error_inside_names_the_file_and_not_its_temporary(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    with pytest.raises(InputError) as caught, atomic_writes([target]) as (temporary,):
        raise FileFormatError(f"{temporary}: no good")
    assert str(caught.value) == f"{target}: no good"


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    real, link = tmp_path / "there" / "real.txt", tmp_path / "link.txt"
    for existing in (False, True):
        link.unlink(missing_ok=True)
        link.symlink_to(real)
        assert real.exists() is existing
        with atomic_write(link) as temporary:
            temporary.write_text(f"new {existing}")
        assert link.is_symlink()
        assert real.read_text() == f"new {existing}"
        assert list((tmp_path / "there").iterdir()) == [real]


def test_devices_are_written_into_and_not_replaced(tmp_path: Path) -> None:
    full = tmp_path / "a.txt"
    full.symlink_to("/dev/full")
    other = tmp_path / "b.txt"
    with pytest.raises(InputError, match=r"a\.txt: cannot be written \(No space left"):
        _write([other, full])
    assert list(tmp_path.iterdir()) == [full]
    assert Path("/dev/full").is_char_device()
    nothing = tmp_path / "c.txt"
    nothing.symlink_to("/dev/null")
    with atomic_write(nothing) as temporary:
        temporary.write_text("x")
    assert Path("/dev/null").is_char_device()


def test_left_over_temporaries_are_found(tmp_path: Path) -> None:
    target = tmp_path / f"{'ä' * 110}.txt"
    (tmp_path / ".hidden.txt").write_text("not ours")
    (tmp_path / "a.12345678.tmp.png").write_text("not ours")
    with atomic_write(target) as temporary:
        temporary.write_text("half")
        assert stale_temporaries(tmp_path) == []
        assert stale_temporaries(tmp_path, older_than_s=0.0) == [temporary]
        two_hours_ago = time.time() - 7200
        os.utime(temporary, (two_hours_ago, two_hours_ago))
        assert stale_temporaries(tmp_path) == [temporary]
    assert stale_temporaries(tmp_path, older_than_s=0.0) == []


FULL_DISK = """
import resource, signal, sys, torch
from steered_marigold.errors import InputError
from steered_marigold.io.depth_maps import write_depth
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    write_depth(sys.argv[1], 1 + torch.rand(60, 80))
except InputError as error:
    print(error)
"""


@pytest.mark.parametrize("suffix", [".png", ".npy", ".tiff", ".exr"])
@pytest.mark.parametrize("room", [200, 2000])
def test_no_half_file_where_there_is_no_room(tmp_path: Path, suffix: str, room: int) -> None:
    """The system's limit on a file's size stands for a full disk."""
    path = tmp_path / f"a{suffix}"
    run = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(path), str(room)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert run.stdout.strip() == f"{path}: cannot be written (File too large)"
    assert not list(tmp_path.iterdir())
