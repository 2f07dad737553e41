"""Visitors of the page without a browser: what many requests at once, and many in turn, cost.

They speak to the page as its own script does. See `benchmarks.page`, which runs this.
"""

import json
import secrets
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

_PATIENCE_S = 3600.0
_MIB = 1024


@dataclass(frozen=True)
class Handlers:
    """Numbers of the page's functions, as its `config` has them."""

    open_sample: int
    open_inputs: list[Any]
    begin: int
    complete: int
    complete_inputs: list[Any]


def find_handlers(url: str) -> Handlers:
    """What the buttons “Room” and “Complete” call, and the values that it is given at first."""
    config = httpx.get(f"{url}config", timeout=_PATIENCE_S).raise_for_status().json()
    parts = {part["id"]: part["props"] for part in config["components"]}
    functions = config["dependencies"]

    def called(button: str) -> dict[str, Any]:
        (number,) = (i for i, props in parts.items() if props.get("value") == button)
        return next(f for f in functions if [number, "click"] in f["targets"])

    def values(function: dict[str, Any]) -> list[Any]:
        return [parts[number].get("value") for number in function["inputs"]]

    room, begin = called("Room"), called("Complete")
    complete = next(f for f in functions if f.get("trigger_after") == begin["id"])
    return Handlers(room["id"], values(room), begin["id"], complete["id"], values(complete))


class Visitor:
    """Someone with a session, who opens the sample at once."""

    def __init__(self, url: str, handlers: Handlers) -> None:
        self._url, self._handlers = f"{url}gradio_api/queue/", handlers
        self._session = secrets.token_hex(8)
        self._client = httpx.Client(timeout=_PATIENCE_S)
        self._ask(handlers.open_sample, handlers.open_inputs)
        self.wait(1)
        body = {"fn_index": handlers.begin, "data": [], "session_hash": self._session}
        self._client.post(f"{url}gradio_api/run/predict", json=body).raise_for_status()

    def ask(self) -> bool:
        """For a completion; False where the queue is full."""
        return self._ask(self._handlers.complete, self._handlers.complete_inputs)

    def _ask(self, function: int, values: list[Any]) -> bool:
        body = {"fn_index": function, "data": values, "session_hash": self._session}
        answer = self._client.post(f"{self._url}join", json=body)
        if answer.status_code == httpx.codes.SERVICE_UNAVAILABLE:
            return False
        answer.raise_for_status()
        return True

    def wait(self, count: int) -> None:
        """Until so many requests are answered. Raises RuntimeError if one of them fails."""
        for said in self._messages():
            if said["msg"] != "process_completed":
                continue
            if not said["success"] or "box error" in json.dumps(said["output"]):
                raise RuntimeError(f"a request failed: {said['output']}")
            count -= 1
            if not count:
                return
        raise RuntimeError("the page ended the connection before it answered")

    def _messages(self) -> Iterator[dict[str, Any]]:
        how = {"session_hash": self._session}
        with self._client.stream("GET", f"{self._url}data", params=how) as stream:
            for line in stream.iter_lines():
                if line.startswith("data:"):
                    yield json.loads(line.removeprefix("data:"))


def resident_mib(process_id: int) -> float:
    """[MiB]"""
    lines = Path(f"/proc/{process_id}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:")) / _MIB


def at_once(url: str, handlers: Handlers, *, visitors: int, requests: int) -> dict[str, float]:
    """So many requests of so many visitors before the first is answered.

    Returns how many were taken, the seconds until all of these were answered, and the longest that
    the page itself took to come meanwhile.
    """
    people = [Visitor(url, handlers) for _ in range(visitors)]
    begun = time.perf_counter()
    with ThreadPoolExecutor(visitors + 1) as pool:
        asked = [pool.submit(person.ask) for _ in range(requests // visitors) for person in people]
        taken = sum(future.result() for future in asked)
        shares = {p: sum(f.result() for f in asked[i::visitors]) for i, p in enumerate(people)}
        waiting = [pool.submit(p.wait, n) for p, n in shares.items() if n]
        slowest = 0.0
        while not all(future.done() for future in waiting):
            opened = time.perf_counter()
            httpx.get(url, timeout=_PATIENCE_S).raise_for_status()
            slowest = max(slowest, time.perf_counter() - opened)
            time.sleep(1)
        for future in waiting:
            future.result()
    return {"taken": taken, "seconds": time.perf_counter() - begun, "slowest_page_s": slowest}


def in_turn(url: str, handlers: Handlers, process_id: int, *, requests: int) -> list[float]:
    """The process's memory [MiB] after each completion of one visitor."""
    person = Visitor(url, handlers)
    memory = []
    for _ in range(requests):
        person.ask()
        person.wait(1)
        memory.append(resident_mib(process_id))
    return memory
