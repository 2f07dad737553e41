"""Every engine gives every result, whatever dies on the way."""

from typing import Any

import pytest

from steered_marigold.batch.engines import LocalEngine
from steered_marigold.errors import CheckpointError, SteeredMarigoldError
from tests.batch.workers import dying, failing, lost, squaring


@pytest.mark.parametrize("workers", [1, 2])
def test_each_task_has_its_result(workers: int) -> None:
    engine = LocalEngine(workers=workers, threads=1)
    results: list[Any] = list(engine.work(squaring, iter(range(7)), lost=lost))
    assert sorted(results) == [0, 1, 4, 9, 16, 25, 36]
    assert list(engine.work(squaring, iter(()), lost=lost)) == []
    assert engine.describe() == {"engine": "local", "workers": workers, "threads": 1}


def test_a_task_that_ends_its_process_is_lost_alone() -> None:
    engine = LocalEngine(workers=2, threads=1)
    results = list(engine.work(squaring, [1, -1, 2, 3, 4], lost=lost))
    assert [x for x in results if isinstance(x, str)] == ["-1: its process was ended by SIGKILL"]
    assert sorted(x for x in results if isinstance(x, int)) == [1, 4, 9, 16]


def test_workers_that_cannot_start_say_why() -> None:
    engine = LocalEngine(workers=2, threads=1)
    with pytest.raises(CheckpointError, match="no such checkpoint"):
        list(engine.work(failing, [1], lost=lost))
    with pytest.raises(SteeredMarigoldError, match=r"before its first frame .*code 3"):
        list(engine.work(dying, [1], lost=lost))
