"""Whole files or none."""

from pathlib import Path

import pytest

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.files import (
    atomic_write,
    create_folder,
    require_file,
    require_suffix,
    require_writable,
)


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
