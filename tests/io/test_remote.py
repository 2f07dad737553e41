"""URLs as paths, on fsspec's own file systems."""

import errno
import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from steered_marigold.errors import FileFormatError, InputError
from steered_marigold.io.depth_maps import read_depth, write_depth
from steered_marigold.io.files import atomic_writes
from steered_marigold.io.remote import RemotePath, location
from tests.frames.completers import write_frame


@pytest.fixture
def bucket() -> Iterator[Path]:
    """An empty store in memory."""
    MemoryFileSystem.store.clear()
    yield location("memory://bucket")
    MemoryFileSystem.store.clear()


@pytest.mark.parametrize("url", ["s3://bucket/a/b.depth.png", "gs://bucket/a b/ü", "az+x://c/d"])
def test_urls_are_paths_by_name(url: str) -> None:
    path = location(url)
    assert isinstance(path, RemotePath)
    assert str(path) == f"{path}" == url
    assert str(path.parent / path.name) == url
    assert path.resolve() == path == pickle.loads(pickle.dumps(path))
    assert (path.name, path.stem, path.suffix) == (
        (name := url.rpartition("/")[2]),
        Path(name).stem,
        Path(name).suffix,
    )


def test_what_is_no_url_is_a_path_of_this_machine(tmp_path: Path) -> None:
    assert location("a/b.png") == Path("a/b.png")
    assert location((tmp_path / "a b").as_uri()) == tmp_path / "a b"
    assert not isinstance(location("s3:/bucket/key"), RemotePath)
    for url in ("s3://bucket//key", "s3://bucket/./key"):
        with pytest.raises(InputError, match="a part of the URL is empty"):
            location(url)


def test_bytes_are_read_as_written(bucket: Path) -> None:
    assert (list(bucket.iterdir()), bucket.exists()) == ([], False)
    path = bucket / "a" / "b.bin"
    path.write_bytes(b"0123456789")
    assert isinstance(path, RemotePath)
    assert (path.read_bytes(), path.read_range(2, 4)) == (b"0123456789", b"23")
    assert (path.is_file(), path.is_dir(), path.parent.is_dir()) == (True, False, True)
    (bucket / "c").write_bytes(b"")
    assert sorted(bucket.iterdir()) == [bucket / "a", bucket / "c"]
    path.unlink()
    path.unlink(missing_ok=True)
    for refused in (path.read_bytes, path.unlink):
        with pytest.raises(FileFormatError, match=r"memory://bucket/a/b.bin: no such object"):
            refused()


def test_what_opens_files_by_itself_is_refused(bucket: Path) -> None:
    (bucket / "a.npy").write_bytes(b"x")
    for opens in (np.load, Path.stat, Path.open):
        with pytest.raises(InputError, match=r"memory://bucket/a.npy: is not on this machine"):
            opens(bucket / "a.npy")


def test_storage_that_cannot_be_had_is_named() -> None:
    with pytest.raises(InputError, match="nothing://bucket: Protocol not known"):
        location("nothing://bucket").is_dir()
    with pytest.raises(InputError, match="nothing://bucket/a: Protocol not known"):
        location("nothing://bucket/a").write_bytes(b"")


def test_outputs_become_whole_objects_or_none(bucket: Path, tmp_path: Path) -> None:
    write_frame(tmp_path / "image.png", tmp_path / "depth.png", seed=0)
    depth = read_depth(tmp_path / "depth.png").depth
    write_depth(bucket / "depth.npy", depth)
    np.save(tmp_path / "depth.npy", depth.numpy())
    assert (bucket / "depth.npy").read_bytes() == (tmp_path / "depth.npy").read_bytes()
    paths = [bucket / "new.png", tmp_path / "local.png"]

    def break_off() -> None:
        with atomic_writes(paths) as temporaries:
            temporaries[0].write_bytes(b"half")
            raise InputError(f"{temporaries[0]}: is bad")

    with pytest.raises(InputError, match=r"^memory://bucket/new.png: is bad$"):
        break_off()
    assert sorted(bucket.iterdir()) == [bucket / "depth.npy"]
    assert not paths[1].exists()
    with atomic_writes(paths) as temporaries:
        for temporary in temporaries:
            temporary.write_bytes(b"whole")
    assert paths[0].read_bytes() == paths[1].read_bytes() == b"whole"


def test_an_object_that_cannot_be_put_would_end_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    path = location("local://file/below.png")
    with pytest.raises(InputError, match=r"file/below.png: cannot be written \(") as told:
        path.write_bytes(b"x")
    assert isinstance(told.value.__cause__, OSError)
    assert told.value.__cause__.errno == errno.EIO
