"""Code that changes under its name, and names, tables and places that cannot be."""

import dataclasses
import functools
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

import lissajous_env
from baselines.benchmark.running import run
from baselines.benchmark.types import Benchmark
from lissajous_env.parameters import robot_models
from lissajous_env.storage.files import check_writable_file
from lissajous_env.storage.folder import Folder
from lissajous_env.world.robots.point import POINT
from tests.adversarial import Attack, held_back
from tests.adversarial.terminal import pick

_QUIET = Console(quiet=True)


class _Fixed:
    """A policy that always does the same."""

    def __init__(self, scenario: Any, num_worlds: int, device: Any, share: Any = 0.0, weights: Any = None):
        self.num_worlds, self.share, self.weights = num_worlds, share, weights
        self._shape = num_worlds, scenario.num_robots, scenario.action_size

    def reset(self, worlds: Any = None) -> None:
        pass

    def act(self, observation: Any) -> Any:
        return np.full(self._shape, np.sum(self.share if self.weights is None else self.weights), dtype=np.float32)


def _closure(share: Any) -> Any:
    return lambda scenario, num_worlds, device: _Fixed(scenario, num_worlds, device, share)


def _default(share: float) -> Any:
    def make(scenario: Any, num_worlds: int, device: Any, chosen: float = share) -> _Fixed:
        return _Fixed(scenario, num_worlds, device, chosen)

    return make


def _nested(share: float) -> Any:
    table = {"gains": [1.0, {"deep": np.array([share])}], "names": {"b", "a"}}
    return lambda scenario, num_worlds, device: _Fixed(scenario, num_worlds, device, table["gains"][1]["deep"])


def _local_class(share: float) -> Any:
    class Local(_Fixed):
        def act(self, observation: Any) -> Any:
            return super().act(observation) + np.float32(share)

    return Local


def _instance(share: float) -> Any:
    return _Fixed(lissajous_env.scenario("ideal"), 1, "cpu", weights=np.full(3, share))


_MAKERS = (
    _closure, _default, _nested, _local_class, _instance, lambda share: functools.partial(_Fixed, share=share),
    lambda share: functools.partial(_Fixed, weights=np.full(2, share)), lambda share: _closure(_Share(share)),
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _Share:
    value: float

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return np.array(self.value, dtype)


def captured(draw: np.random.Generator) -> str | None:
    """Go on with a policy or an extension of other captured values: refused; with the same: all rows are there."""
    share, other = (float(np.float32(each)) for each in draw.uniform(-1, 1, 2))
    maker, extends = pick(draw, _MAKERS), draw.random() < 0.3

    def term(weight: float) -> Any:
        def weighted(world: Any) -> Any:
            return weight * world.robots.speed

        return lissajous_env.reward_term()(weighted)

    def play(folder: str, episodes: int, captured: float) -> int:
        brought = [term(captured)] if extends else []
        scenario = lissajous_env.scenario("ideal", extensions=brought, **{"task.duration": 0.5})
        settings = Benchmark(("ideal",), (), episodes, batch=1, out=Path(folder), replays=("none",))
        return len(run(settings, {"mine": maker(share if extends else captured)}, [scenario], _QUIET))

    with tempfile.TemporaryDirectory() as folder:
        if play(folder, 1, share) != 1 or play(folder, 2, share) != 2:
            return f"{maker}: the same did not go on"
        try:
            play(folder, 3, other)
        except ValueError as error:
            rows = len(Path(folder, "episodes.jsonl").read_text().splitlines())
            said = "with other code" in str(error)
            return None if said and rows == 2 else f"{maker}: {rows} rows, {error}"
    return f"{maker}: another was taken"


_NAMES: tuple[Any, ...] = (
    "", " ", "a b", "a\n", "a/b", "../a", "[b]", "car", "é" * 200, "x" * 100, 3, None, b"a", "\0", "a" * 64
)  # fmt: skip
_NUMBERS: tuple[Any, ...] = (np.nan, np.inf, -np.inf, 2.0, -1.01, "1", None, 1j, True, [], 10**400, np.float32(np.nan))


def models(draw: np.random.Generator) -> str | None:
    """Register a model of robots that cannot be one: refused in a line, and no model is added."""
    wrong = pick(draw, ["name", "table", "rest", "actions"])
    value = {
        "name": pick(draw, _NAMES),
        "table": ((pick(draw, _NUMBERS),), (1.0,)) if draw.random() < 0.7 else pick(draw, [(), ((),), ((1.0, 1.0),)]),
        "rest": (pick(draw, _NUMBERS),) if draw.random() < 0.7 else pick(draw, [(), (0.0, 0.0)]),
        "actions": pick(draw, [(), ("",), ("a", "a"), (3,), (" a",)]),
    }[wrong]
    before = robot_models.robot_kinds()
    seen: list[Any] = []

    def register() -> None:
        seen.append(lissajous_env.register_robot_model(dataclasses.replace(POINT, **{"name": "new", wrong: value})))

    words = held_back(register)
    for name in set(robot_models.robot_kinds()) - set(before):
        del robot_models._MODELS[name]
    return words or (f"{wrong} = {value!r:.80} was taken" if seen else None)


def entries(draw: np.random.Generator) -> str | None:
    """Bring observation entries whose names may meet: refused, or every name is there once."""
    count = int(draw.integers(2, 5))
    names = [pick(draw, ["a", "a_0", "a_1", "a_1_0", "b", "a_0_1"]) for _ in range(count)]
    sizes = [int(draw.integers(1, 4)) for _ in range(count)]
    brought = []
    for name, size in zip(names, sizes, strict=True):
        values = lambda world, size=size: np.zeros((*world.robots.speed.shape, size)[: 2 + (size > 1)])  # noqa: E731
        values.__name__ = name
        brought.append(lissajous_env.observation_entry(size)(values))
    seen: list[Any] = []
    made = lambda: seen.append(lissajous_env.Simulation(lissajous_env.scenario("ideal", extensions=brought)))  # noqa: E731
    if words := held_back(made):
        return f"{names}, {sizes}: {words}"
    layout = seen[0].layout.names if seen else ()
    return f"{names}, {sizes}: names {layout}" if len(set(layout)) < len(layout) else None


def places(draw: np.random.Generator) -> str | None:
    """Give an --out that cannot be: refused in a line, and nothing is made."""
    with tempfile.TemporaryDirectory() as home:
        Path(home, "file").write_text("mine")
        Path(home, "link").symlink_to(Path(home, "gone"))
        wrong = [
            "x" * int(draw.integers(256, 3000)), "é" * 130, "/".join(["y" * 250] * int(draw.integers(17, 30))),
            "file", "file/inside", "file/inside/deeper", "link/inside", "/proc/self/x", "/dev/null", "/dev/full/x",
            "/proc/x", "\ud800", "a\0b",
        ]  # fmt: skip
        place = pick(draw, wrong)
        path = place if place.startswith("/") else f"{home}/{place}"
        for name, call in (("file", lambda: check_writable_file(f"{path}/a.csv")), ("folder", lambda: Folder(path))):
            words = _refused(call)
            if words is not None:
                return f"{name} {place[:60]!r}: {words}"
        kept = sorted(os.listdir(home))
        made = [each for each in kept if each not in ("file", "link", place.split("/")[0])]
        return f"{place[:60]!r} made {made}" if made or Path(home, "file").read_text() != "mine" else None


def _refused(call: Any) -> str | None:
    try:
        call()
    except ValueError as error:
        return None if len(str(error)) < 1000 and "\n" not in str(error) else f"{len(str(error))} letters"
    return "was taken"


ATTACKS = [
    Attack("captured values of a results folder", "The same code resumes, different code is rejected.", 40, captured),
    Attack("models of robots that cannot be", "The model is rejected in one line, and not registered.", 200, models),
    Attack("names of observation entries", "The names are rejected, or each exists once.", 60, entries),
    Attack(
        "places that cannot be written to",
        "The command is rejected in one line before any work, and nothing is written.",
        100,
        places,
    ),
]
