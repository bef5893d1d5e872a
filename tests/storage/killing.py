"""Ends a process at the k-th time that it writes to a folder, or lets the disk be full from there on.

Every new file and folder, every write, rename and removal is a point, in the order in which they come; so all of them
can be tried, one after the other. The processes are forked from one that has the libraries loaded, and begin at once.
"""

import errno
import itertools
import json
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rich.console import Console

QUIET = Console(quiet=True)
_LOADED = ["torch._dynamo", "matplotlib.backends.backend_agg", "training.trainer"]
_LOADED += ["training.learned.policy", "baselines.benchmark.running"]
_ADDS = ("open", "os.mkdir", "os.rename", "write", "fsync")
"""Operations that a full disk refuses."""


@dataclass(frozen=True)
class Ended:
    """End of a process."""

    killed: bool
    error: str
    """Error that it raised, as `Name: words`; empty if it ran to its end."""
    writes: int
    """Points that it came to; 0 where it was killed."""


def run(work: Callable[[Path], None], folder: Path, point: int = -1, full: bool = False) -> Ended:
    """Do some work on a folder in a process of its own.

    Args:
        work: What is done; a function of a module.
        folder: What it is done to. Writes elsewhere do not count.
        point: Number of the write that the process does not survive, from 0; a write of bytes is half done. -1: none.
        full: From that write on the disk is full instead.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_LOADED)
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(work, folder, point, full, sender))
    process.start()
    sender.close()
    try:
        error, writes = receiver.recv()
    except EOFError:
        error, writes = "", 0
    process.join()
    return Ended(process.exitcode == -signal.SIGKILL, error, writes)


def _work(work: Callable[[Path], None], folder: Path, point: int, full: bool, answer: Connection) -> None:
    sys.stdout = sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - for the life of the process
    points = _Points(folder.resolve(), point, full)
    points.watch()
    error = ""
    try:
        work(folder)
    except BaseException as raised:
        error = f"{type(raised).__name__}: {raised}"
    points.over = True
    answer.send((error, next(points.counted)))


class _Points:
    """Counts what a process writes to a folder, and ends it at one of the points."""

    def __init__(self, folder: Path, point: int, full: bool):
        self.folder, self.point, self.full = str(folder), point, full
        self.counted, self.over = itertools.count(), False

    def watch(self) -> None:
        """Count from now on."""
        sys.addaudithook(self._heard)
        self._write, self._fsync = os.write, os.fsync
        os.write, os.fsync = self._writing, self._flushing

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if flags & (os.O_CREAT | os.O_TRUNC) and self._is_inside(path):
                self._at(event, path)
        elif event in ("os.mkdir", "os.remove", "os.rename", "os.truncate") and self._is_inside(arguments[0]):
            self._at(event, arguments[0])

    def _writing(self, descriptor: int, data: Any) -> int:
        if self._is_inside(descriptor):
            self._at("write", None, lambda: self._write(descriptor, bytes(data)[: len(data) // 2]))
        return self._write(descriptor, data)

    def _flushing(self, descriptor: int) -> None:
        # A kill leaves the same files before a flush as after it.
        if self.full and self._is_inside(descriptor):
            self._at("fsync")
        self._fsync(descriptor)

    def _at(self, event: str, path: Any = None, half: Callable[[], object] = lambda: None) -> None:
        """Count a point, and end the process there; errors name a path, but not a descriptor, as the system's do."""
        reached = next(self.counted)
        if self.over or self.point < 0 or reached < self.point:
            return
        if not self.full:
            half()
            os.kill(os.getpid(), signal.SIGKILL)
        elif event in _ADDS:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)

    def _is_inside(self, path: Any) -> bool:
        if isinstance(path, int):
            try:
                path = os.readlink(f"/proc/self/fd/{path}")
            except OSError:
                return False
        return not self.over and os.path.abspath(os.fsdecode(path)).startswith(self.folder)


def train(folder: Path) -> None:
    """Train for three rollouts with an evaluation before and after each; that after the first is the best."""
    import torch

    from training.settings import TrainingSettings
    from training.trainer import train

    torch.set_num_threads(1)
    settings = TrainingSettings(
        "failure", steps=240, worlds=2, rollout=8, minibatch=32, hidden=8, features=8, episodes=1, threads=1,
        evaluate_every=80, out=folder,
        overrides={"task.duration": 0.5, "robot.count": 5},
    )  # fmt: skip
    train(settings, QUIET)


def benchmark(folder: Path) -> None:
    """Play two policies for three episodes, in batches."""
    from baselines.benchmark.running import run
    from baselines.benchmark.types import Benchmark

    settings = Benchmark(("failure",), ("kuramoto", "still"), 3, batch=2, out=folder, overrides={"task.duration": 0.5})
    run(settings, console=QUIET)


def result_of_train(folder: Path) -> dict[str, Any]:
    """Read all that a training leaves, without its times.

    Raises:
        ValueError: a part of it is damaged, or they do not agree.
    """
    from training.learned import checkpoint

    network, _, description = checkpoint.read(folder)
    state = checkpoint.read_state(folder)
    best, _, of_best = checkpoint.read(folder / "best")
    history, best_history = description["training"], of_best["training"]
    highest = history["best"]
    if best_history["best"]["steps"] != highest["steps"] or best_history["curve"][-1]["steps"] != highest["steps"]:
        raise ValueError(f"best must be the policy of {highest}, got {best_history['best']}")
    return {
        "state": {name: array.tolist() for name, array in state.items()},
        "curve": _untimed(history["curve"]),
        "weights": {name: array.tolist() for name, array in network.arrays.items()},
        "best": {name: array.tolist() for name, array in best.arrays.items()},
        "names": sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*")),
    }


def result_of_benchmark(folder: Path) -> dict[str, Any]:
    """Read all that a benchmark leaves, without its times."""
    summary = json.loads((folder / "summary.json").read_text())
    rows = sorted((folder / "episodes.jsonl").read_text().splitlines())
    rest = {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in (".png", ".csv")}
    names = sorted(path.name for path in folder.iterdir())
    return rest | {"rows": rows, "statistics": summary["statistics"], "names": names}


def _untimed(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{name: value for name, value in entry.items() if name != "seconds"} for entry in entries]


WORK: dict[str, tuple[Callable[[Path], None], Callable[[Path], dict[str, Any]]]] = {
    "train": (train, result_of_train),
    "benchmark": (benchmark, result_of_benchmark),
}
"""Commands in the small, and what reads their results."""
