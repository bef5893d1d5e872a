"""Reading and checks of a recording's file: its scenario is valid, and its arrays fit the scenario and each other."""

import zipfile
from collections.abc import Mapping, Sequence
from typing import Any, BinaryIO

import numpy as np

from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import scenario_of
from lissajous_env.world.state import NEVER

MOST_BYTES = 2**30
"""Limit on the total size of a recording [bytes]."""
_PLAIN = (str, int, float, type(None))
"""Valid types of values in a score row; a bool is an int."""


def read_arrays(file: BinaryIO, dtypes: Mapping[str, np.dtype], text: str) -> tuple[str, dict[str, np.ndarray]]:
    """Read a text and arrays by their names from an .npz file; nothing is unpickled.

    Raises:
        KeyError: an array is missing.
        ValueError: the file is no archive, unpacks to more than a gibibyte, or an array has a wrong type.
    """
    with zipfile.ZipFile(file) as archive:
        if sum(member.file_size for member in archive.infolist()) > MOST_BYTES:
            raise ValueError(f"its arrays must contain at most {MOST_BYTES:,} bytes together")
    with np.load(file, allow_pickle=False) as stored:
        for name in (text, *dtypes):
            if name not in stored.files:
                raise KeyError(name)
        arrays = {name: stored[name] for name in (text, *dtypes)}
    words = str(arrays.pop(text))
    for name, dtype in dtypes.items():
        if arrays[name].dtype != dtype:
            raise ValueError(f"its {name} must be {dtype}, got {arrays[name].dtype}")
    return words, arrays


def made_scenario(saved: dict[str, Any]) -> Scenario:
    """Make the scenario of a recording.

    Raises:
        ValueError: the scenario is invalid, or a derived field is not filled in.
    """
    made = scenario_of(saved)
    derived = {"robot": ("count", "phase_rate_max"), "formation": ("p", "alpha", "ring"), "sensing": ("radius",)}
    for part, fields in derived.items():
        for field in fields:
            if getattr(getattr(made, part), field) is None:
                raise ValueError(f"its {part}.{field} must be given")
    return made


def check(recording: Any, fixed: Sequence[str]) -> None:
    """Check that the arrays of a recording fit the scenario and each other; `fixed` ones have shape (T,).

    Raises:
        ValueError: an array, a name or the score is invalid.
    """
    f, scenario, latest = len(recording.position), recording.scenario, int(NEVER)
    for name, shape in _shapes(recording, fixed).items():
        array = getattr(recording, name)
        if array.shape != shape or f == 0:
            raise ValueError(f"its {name} must have shape {shape}, got {array.shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"its {name} must contain finite numbers")
        if array.dtype.kind == "i" and array.size and not -latest <= array.min() <= array.max() <= latest:
            raise ValueError(f"its {name} must contain numbers from {-latest} to {latest}")
    if ((recording.found_early < 0) | (recording.found_early > 1)).any():
        raise ValueError("its found_early must contain shares from 0 to 1")
    contact = recording.contact
    if (contact < 0).any() or (contact >= [f, scenario.num_robots, scenario.num_robots]).any():
        raise ValueError("its contact must contain moments and robots of the recording")
    if f > scenario.task.steps + 1:
        raise ValueError(f"its moments must be at most the {scenario.task.steps} steps and the reset, got {f}")
    for blank in recording.unknown:
        what, *places = blank if len(blank) == 4 else ("",)
        if what not in ("pose", "speed", "command") or not all(type(place) is int for place in places):
            raise ValueError("its unknown must contain names with a robot and two moments")
        if not 0 <= places[0] < scenario.num_robots or not 0 <= places[1] <= places[2] < f:
            raise ValueError("its unknown must contain robots and moments of the recording")
    for name in ("observation_names", "reward_names"):
        if not all(isinstance(each, str) for each in getattr(recording, name)):
            raise ValueError(f"its {name} must contain text")
    _check_score(recording.score)


def _shapes(recording: Any, fixed: Sequence[str]) -> dict[str, tuple[int, ...]]:
    scenario = recording.scenario
    f, n, t = len(recording.position), scenario.num_robots, len(recording.motion)
    columns, rows = scenario.task.grid or (1, 1)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("heading", "speed", "phase", "status"), (f, n))
    shapes |= dict.fromkeys(fixed, (t,))
    shapes |= {"position": (f, n, 3), "target_position": (f, t, 2), "sensed_at": (f, rows, columns)}
    shapes |= {"contact": (len(recording.contact), 3), "collisions": (f,), "heard_at": (f, n, 2)}
    shapes |= {"introduced_at": (f, scenario.spreading.rows, scenario.spreading.columns)}
    shapes |= {"observation": (f, n, len(recording.observation_names)), "action": (f, n, scenario.action_size)}
    return shapes | {"reward_terms": (f, n, len(recording.reward_names))}


def _check_score(score: Any) -> None:
    if not isinstance(score, dict) or not all(isinstance(value, _PLAIN) for value in score.values()):
        raise ValueError("its score must contain numbers and text by name")
    seed = score.get("seed")
    if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**31:
        raise ValueError("its score must contain the seed, a whole number from 0 to 2147483647")
