"""Attacks on what lies on the disk: files of the user, kills, full disks, folders that somebody changed."""

import contextlib
import copy
import functools
import io
import itertools
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.storage.folder import LIST
from tests.adversarial import Attack, killing

_STEMS = (
    "weights-abc",
    "weights-0123456789ab",
    "state-0123456789ab",
    ".env",
    ".x.tmp",
    ".lissajous-0123456789abcdef",
    "x",
)
_ENDS = (".tmpl", ".safetensors", ".tmp", ".tmp.json", ".json", ".png", ".jsonl", "", ".123.tmp.csv")
_RESULTS = (
    "settings.json", "episodes.jsonl", "episodes.csv", "summary.json", "collisions.png", "README.md", "table.csv",
    "checkpoint.json", "best", "tensorboard", LIST, ".lock", "theorem2.png", "knot.png",
)  # fmt: skip
_HOSTILE = (
    None, True, -1, 3, 0.5, 10**400, 1e300, 1e-300, "", "x", "../x", "/etc/passwd", "a\0b", "\ud800", "sweep", ".", [],
    {}, ["x"] * 3, {"a": 1}, float("nan"), float("inf"), json.loads(150 * "[" + 150 * "]"), "x" * 10_000,
)  # fmt: skip


def _in_a_folder(attempt: Callable[[np.random.Generator, Path], str | None]) -> Callable[[np.random.Generator], Any]:
    """Give an attempt a folder of its own, which is removed after it."""

    @functools.wraps(attempt)
    def held(draw: np.random.Generator) -> str | None:
        with tempfile.TemporaryDirectory() as folder:
            return attempt(draw, Path(folder))

    return held


@_in_a_folder
def _files_of_the_user(draw: np.random.Generator, folder: Path) -> str | None:
    out, outside = folder / "out", folder / "outside"
    out.mkdir()
    outside.mkdir()
    work, _ = killing.WORK[str(draw.choice(list(killing.WORK), p=[0.45, 0.45, 0.1]))]
    if draw.random() < 0.3:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            work(out)
    for k in range(draw.integers(1, 8)):
        name = str(draw.choice(_RESULTS) if draw.random() < 0.15 else draw.choice(_STEMS) + draw.choice(_ENDS))
        path, target = out / name, outside / str(k)
        target.write_bytes(draw.bytes(draw.integers(0, 50)))
        if os.path.lexists(path):
            continue
        kind = draw.choice(["file", "link", "hard link", "broken link", "folder"], p=[0.5, 0.2, 0.1, 0.1, 0.1])
        if kind == "file":
            shutil.copy(target, path)
        elif kind == "folder":
            path.mkdir()
            shutil.copy(target, path / "kept")
        elif kind == "hard link":
            os.link(target, path)
        else:
            path.symlink_to(target if kind == "link" else outside / f"{k}-nothing")
    ours = {json.loads(line).get("wrote") for line in _lines(out / LIST)}
    before = {path: state for path, state in _states(folder).items() if _name(path, out) not in {*ours, LIST}}
    for _ in range(2):
        try:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                work(out)
        except ValueError as error:
            if "\n" in str(error):
                return f"an error without a clear line: {error}"
    after = _states(folder)
    lost = [str(path) for path, state in before.items() if after.get(path) != state]
    made = [str(path) for path in after if path not in before and not path.is_relative_to(out)]
    return f"changed: {lost}; made: {made}" if lost or made else None


def _name(path: Path, out: Path) -> str:
    return path.relative_to(out).as_posix() if path.is_relative_to(out) else ""


def _lines(path: Path) -> Iterator[str]:
    """Lines of a list that is ours."""
    if path.is_file() and not path.is_symlink() and path.read_bytes().startswith(b'{"lissajous": 1'):
        yield from path.read_text().splitlines()


def _states(folder: Path) -> dict[Path, Any]:
    """Return the content of each file, the target of each link, and the names of the folders."""
    found = {}
    for path in folder.rglob("*"):
        found[path] = os.readlink(path) if path.is_symlink() else path.read_bytes() if path.is_file() else None
    return found


class _AtEachWrite:
    """Ends a command at one write after the other, a try each, and compares what the next call makes of it."""

    def __init__(self, name: str, full: bool = False, every: int = 1):
        self.work, self.read = killing.WORK[name]
        self.full, self.points = full, itertools.count(0, every)

    @functools.cached_property
    def whole(self) -> tuple[dict[str, Any], int]:
        """Return the results of an undisturbed command, and the number of its writes."""
        with tempfile.TemporaryDirectory() as folder:
            ended = killing.run(self.work, Path(folder) / "out", full=self.full)
            return self.read(Path(folder) / "out"), ended.writes

    def __call__(self, draw: np.random.Generator) -> str | None:
        wanted, writes = self.whole
        point = next(self.points)
        if point >= writes:
            point = int(draw.integers(writes))
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out"
            ended, again = killing.run(self.work, out, point, self.full), killing.run(self.work, out)
            stopped = ended.killed or (self.full and "No space left" in ended.error and "\n" not in ended.error)
            if not stopped or again.error:
                return f"write {point} of {writes}: {ended}, then {again}"
            found = self.read(out)
        differing = [name for name in {**wanted, **found} if wanted.get(name) != found.get(name)]
        return f"write {point} of {writes}: another {', '.join(differing)}" if differing else None


@functools.cache
def _trained() -> dict[str, bytes]:
    """Files of a small training, by name."""
    with tempfile.TemporaryDirectory() as folder:
        killing.train(Path(folder))
        return {path.name: path.read_bytes() for path in Path(folder).iterdir() if path.is_file()}


@_in_a_folder
def _changed_checkpoint(draw: np.random.Generator, folder: Path) -> str | None:

    import training
    from lissajous_env import Simulation
    from training.learned import checkpoint

    for name, data in _trained().items():
        (folder / name).write_bytes(data)
    path = folder / checkpoint.FILE
    if draw.random() < 0.8:
        text = json.loads(path.read_text())
        for _ in range(draw.integers(1, 3)):
            text = _changed(draw, text)
        path.write_text(json.dumps(text))
    else:
        _damage(draw, folder / str(draw.choice(sorted(_trained()))))
    try:
        policy = training.load(folder)
        action = policy.act(Simulation(policy.scenario).observation.numpy())
    except ValueError as error:
        words = str(error)
        return f"an error without a clear line: {words[:300]}" if "\n" in words or len(words) > 1000 else None
    return None if np.isfinite(action).all() and (np.abs(action) <= 1).all() else f"it does {action}"


def _changed(draw: np.random.Generator, text: Any) -> Any:
    """JSON with a hostile value at a place, or without it."""
    text = copy.deepcopy(text)
    inner, places = text, []
    while isinstance(inner, (dict, list)) and inner:
        names = list(inner) if isinstance(inner, dict) else list(range(len(inner)))
        name = names[draw.integers(len(names))]
        places.append((inner, name))
        inner = inner[name]
        if draw.random() < 0.25:
            break
    if not places:
        return _HOSTILE[draw.integers(len(_HOSTILE))]
    inner, name = places[-1]
    if draw.random() < 0.2:
        del inner[name]
    else:
        inner[name] = _HOSTILE[draw.integers(len(_HOSTILE))]
    return text


def _damage(draw: np.random.Generator, path: Path) -> None:
    """Cut a file off, change a byte of it, or make a link, a folder or nothing of it."""
    data = bytearray(path.read_bytes())
    kind = draw.integers(5)
    if kind == 0:
        path.write_bytes(data[: draw.integers(len(data))])
    elif kind == 1:
        data[draw.integers(len(data))] ^= 1 << draw.integers(8)
        path.write_bytes(data)
    else:
        path.unlink()
        if kind == 2:
            path.symlink_to(path.parent)
        elif kind == 3:
            path.mkdir()


_SAME = "The same command, run again, ends with the same bits as an uninterrupted one."
_SAME_AND_ONE_LINE = f"The error is one line; t{_SAME[1:]}"
ATTACKS = [
    Attack(
        "files of the user in --out",
        "These files, and files to which links in the folder lead, do not change.",
        20,
        _files_of_the_user,
    ),
    Attack("a training killed at each write", _SAME, 143, _AtEachWrite("train")),
    Attack("a benchmark killed at each write", _SAME, 40, _AtEachWrite("benchmark")),
    Attack("a reproduction killed at each write", _SAME, 26, _AtEachWrite("reproduce")),
    Attack("disk full in a training", _SAME_AND_ONE_LINE, 20, _AtEachWrite("train", True, 10)),
    Attack("disk full in a benchmark", _SAME_AND_ONE_LINE, 14, _AtEachWrite("benchmark", True, 5)),
    Attack("disk full in a reproduction", _SAME_AND_ONE_LINE, 8, _AtEachWrite("reproduce", True, 5)),
    Attack(
        "a checkpoint that was changed",
        "The checkpoint is rejected in one line, or its actions are finite.",
        500,
        _changed_checkpoint,
    ),
]
