"""Shards give the frames of the files that were packed into them."""

import io
import tarfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest
import torch
from fsspec.implementations.memory import MemoryFileSystem
from PIL import Image

from steered_marigold.batch.engines import LocalEngine
from steered_marigold.batch.job import JobSettings, plan
from steered_marigold.batch.run import complete_all
from steered_marigold.errors import InputError
from steered_marigold.frames.outputs import Outputs
from steered_marigold.frames.shards import holds_shards, shard_source
from steered_marigold.frames.sources import FrameFiles, Reading, read_frame
from steered_marigold.io.remote import location
from tests.batch.workers import load

Folders = tuple[Path, Path]


def _tar(path: Path, members: Mapping[str, bytes]) -> Path:
    path.parent.mkdir(exist_ok=True)
    with tarfile.open(path, "w") as tar:
        for name, content in members.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            tar.addfile(info, io.BytesIO(content))
    return path


def _parquet(path: Path, **columns: object) -> Path:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow.parquet import write_table

    path.parent.mkdir(exist_ok=True)
    write_table(pyarrow.table(columns), path, row_group_size=2)
    return path


@pytest.fixture
def packed(frame_folders: Folders) -> dict[str, tuple[bytes, bytes]]:
    """Image and depth of three frames."""
    images, depths = frame_folders
    return {
        path.stem: (path.read_bytes(), (depths / path.name).read_bytes())
        for path in sorted(images.iterdir())
    }


@pytest.fixture(params=["tar", "parquet"])
def shards(
    packed: dict[str, tuple[bytes, bytes]], tmp_path: Path, request: pytest.FixtureRequest
) -> Path:
    """A folder of two shards, of two frames and of one."""
    folder = tmp_path / "shards"
    for name, keys in (("b", ["0002"]), ("a", ["0000", "0001"])):
        if request.param == "tar":
            members: dict[str, bytes] = {}
            for key in keys:
                image, depth = packed[key]
                members |= {f"./{key}.png": image, f"{key}.json": b"{}", f"{key}.depth.png": depth}
            _tar(folder / f"{name}.tar", members)
        else:
            rows = [packed[key] for key in keys]
            columns = {
                "image": [row[0] for row in rows],
                "depth": [{"bytes": row[1]} for row in rows],
            }
            _parquet(folder / f"{name}.parquet", id=keys, **columns)
    return folder


def test_frames_are_those_of_the_files(shards: Path, frame_folders: Folders) -> None:
    assert holds_shards(shards)
    assert not holds_shards(frame_folders[0])
    source = shard_source(shards, Reading())
    assert (list(source.ids), source.lone) == (["0000", "0001", "0002"], ())
    for frame_id in source.ids:
        ours = source.load(frame_id)
        files = FrameFiles(
            **{
                name: folder / f"{frame_id}.png"
                for name, folder in zip(("image", "depth"), frame_folders, strict=True)
            }
        )
        theirs = read_frame(files, Reading())
        assert torch.equal(ours.sparse_depth, theirs.sparse_depth)
        assert (ours.image == theirs.image).all()
        assert ours.id == frame_id
    first = sorted(shards.iterdir())[0]
    assert holds_shards(first)
    assert list(shard_source(first, Reading()).ids) == ["0000", "0001"]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_over_shards(shards: Path, tmp_path: Path, workers: int) -> None:
    source = shard_source(shards, Reading())
    todo = plan(source, Outputs(depth=tmp_path / "out"), suffix=".png", overwrite=False)
    engine = LocalEngine(workers=workers, threads=1)
    outcomes = complete_all(load, todo, JobSettings(), {}, engine=engine)
    records = {x.record.values["frame"]: x.record.values for x in outcomes if x.record is not None}
    assert sorted(records) == ["0000", "0001", "0002"]
    assert records["0002"]["image"].startswith(f"{shards}/b.")
    assert (tmp_path / "out" / "0001.png").exists()


def test_shards_on_a_store(shards: Path) -> None:
    MemoryFileSystem.store.clear()
    there = location("memory://shards")
    for path in shards.iterdir():
        (there / path.name).write_bytes(path.read_bytes())
    assert holds_shards(there)
    source = shard_source(there, Reading())
    here = shard_source(shards, Reading())
    for frame_id in here.ids:
        assert torch.equal(source.load(frame_id).sparse_depth, here.load(frame_id).sparse_depth)
    assert str(source.files_of("0000").image).startswith("memory://shards/a.")
    MemoryFileSystem.store.clear()


def _encoded(depth: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, depth)
    return file.getvalue()


def test_members_are_told_by_their_names(
    packed: dict[str, tuple[bytes, bytes]], tmp_path: Path
) -> None:
    image, depth = packed["0000"]
    metres = np.asarray(Image.open(io.BytesIO(depth))).astype(np.float32) / 1000
    white = io.BytesIO()
    Image.new("L", (32, 24), 255).save(white, "PNG")
    shard = _tar(
        tmp_path / "shards" / "a.tar",
        {
            "run/1.rgb.png": image,
            "run/1.npy": _encoded(metres),
            "run/1.confidence.png": white.getvalue(),
            "run/2.PNG": image,
            "run/2.depth.npy": _encoded(metres),
            "run/._2.png": b"of another system",
            "run/3.png": image,
            "run/4.depth.png": depth,
        },
    )
    source = shard_source(shard, Reading())
    assert list(source.ids) == ["run_1", "run_2"]
    assert source.lone == (shard / "run/3.png", shard / "run/4.depth.png")
    first, second = (source.load(frame_id) for frame_id in source.ids)
    assert first.confidence is not None
    assert torch.equal(first.sparse_depth, second.sparse_depth)
    relative = shard_source(shard, Reading(no_measurements=True))
    assert list(relative.ids) == ["run_1", "run_2", "run_3"]
    assert not relative.load("run_3").measured


def test_a_bad_frame_is_named_as_in_its_shard(
    packed: dict[str, tuple[bytes, bytes]], tmp_path: Path
) -> None:
    image, depth = packed["0000"]
    shard = _tar(tmp_path / "a.tar", {"1.png": image[:80], "1.depth.png": depth})
    with pytest.raises(InputError, match=rf"^{shard}/1.png: damaged"):
        shard_source(shard, Reading()).load("1")
    rows = {"id": ["1", "2", "3"], "image": [image, b"GIF8", None], "depth": [None, depth, depth]}
    source = shard_source(_parquet(tmp_path / "a.parquet", **rows), Reading())
    assert not source.load("1").measured
    for frame_id in ("2", "3"):
        with pytest.raises(InputError, match=rf"a.parquet/{frame_id}/image: is empty, or begins"):
            source.load(frame_id)


def test_shards_that_cannot_be_used_are_named(
    packed: dict[str, tuple[bytes, bytes]], tmp_path: Path
) -> None:
    image, depth = packed["0000"]
    frame = {"1.png": image, "1.depth.png": depth}
    good = _tar(tmp_path / "good.tar", frame)
    cut, empty, other = (tmp_path / f"{name}.tar" for name in ("cut", "empty", "other"))
    cut.write_bytes(good.read_bytes()[: -len(depth) - 8192])
    empty.touch()
    other.write_bytes(b"something else" * 99)
    for shard in (cut, empty, other):
        with pytest.raises(InputError, match=f"^{shard}: damaged"):
            shard_source(shard, Reading())
    with pytest.raises(InputError, match="no such file"):
        shard_source(tmp_path / "none.tar", Reading())
    with pytest.raises(InputError, match=r"1.jpg and 1.png are both image of one frame"):
        shard_source(_tar(tmp_path / "two.tar", {"1.jpg": image, "1.png": image}), Reading())
    for name in ("a", "b"):
        _tar(tmp_path / "same" / f"{name}.tar", frame)
    with pytest.raises(InputError, match=r"b.tar: its frame 1 is in .*a.tar too"):
        shard_source(tmp_path / "same", Reading())
    with pytest.raises(InputError, match="no column depth, only id, image"):
        shard_source(_parquet(tmp_path / "d.parquet", id=["1"], image=[image]), Reading())
    with pytest.raises(InputError, match="no column id, only image, depth"):
        shard_source(_parquet(tmp_path / "i.parquet", image=[image], depth=[depth]), Reading())
    nameless = {"id": ["1", None], "image": [image] * 2, "depth": [depth] * 2}
    with pytest.raises(InputError, match="its column id is empty in row 1"):
        shard_source(_parquet(tmp_path / "n.parquet", **nameless), Reading())
    texts = _parquet(tmp_path / "t.parquet", id=["1"], image=["x.png"], depth=[depth])
    with pytest.raises(InputError, match="column image does not hold the bytes of files"):
        shard_source(texts, Reading()).load("1")


@pytest.fixture(autouse=True)
def _forget() -> Iterator[None]:
    """Row groups are remembered by path."""
    from steered_marigold.io.shards import _row_group

    yield
    _row_group.cache_clear()


def test_a_tar_that_gets_shorter_is_noticed(
    packed: dict[str, tuple[bytes, bytes]], tmp_path: Path
) -> None:
    image, depth = packed["0000"]
    shard = _tar(tmp_path / "a.tar", {"1.png": image, "1.depth.png": depth})
    source = shard_source(shard, Reading())
    shard.write_bytes(shard.read_bytes()[:600])
    with pytest.raises(InputError, match=r"a.tar: ends within 1.png"):
        source.load("1")
