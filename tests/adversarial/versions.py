"""Names, tables and places that cannot be."""

import dataclasses
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import lissajous_env
from lissajous_env.parameters import robot_models
from lissajous_env.storage.files import check_writable_file
from lissajous_env.storage.folder import Folder
from lissajous_env.world.robots.point import POINT
from tests.adversarial import Attack, held_back
from tests.adversarial.terminal import pick

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
    Attack("models of robots that cannot be", "The model is rejected in one line, and not registered.", 200, models),
    Attack("names of observation entries", "The names are rejected, or each exists once.", 60, entries),
    Attack(
        "places that cannot be written to",
        "The command is rejected in one line before any work, and nothing is written.",
        100,
        places,
    ),
]
