"""The settings of a benchmark and the episodes that have ended, on the disk: score rows, and times of detections.

A folder can grow: by scenarios, policies and episodes. What is there already stays as it is, so all else must agree.
"""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from baselines.benchmark.shown import column_of
from baselines.benchmark.statistics import share_detected
from baselines.benchmark.table import Curve
from baselines.benchmark.types import Batch, Benchmark, Cell
from baselines.policies import registry
from baselines.policies.factories import parts
from lissajous_env.console.terminal import plain
from lissajous_env.identity import digest_of, parts_of
from lissajous_env.parameters.robot_models import is_shipped, model_of
from lissajous_env.parameters.rogues import folder_of, members_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import scenario_of
from lissajous_env.storage.files import read_json
from lissajous_env.storage.folder import Folder, Journal
from lissajous_env.world.columns import COLUMNS, NAMES, WHOLE
from lissajous_env.world.simulation import Simulation

SETTINGS, EPISODES, DETECTIONS = "settings.json", "episodes.jsonl", "detections.jsonl"
FILES = (SETTINGS, EPISODES, DETECTIONS)
"""Files that are preserved."""
MOST_DETECTIONS = 64
"""Number of episodes of a cell whose detection times are stored: enough for a smooth curve."""
_FIXED = ("seed", "device", "versions")
"""Entries of the settings that all calls have in common."""
_ROBOTS, _ROGUES = "robots of kind ", "rogues "
_DETECTION = ("scenario", "policy", "episode", "found", "unfound")
"""Entries of a line of detection times."""

_Key = tuple[str, str, int]


class Results:
    """The settings and score rows in a folder; of an episode that has ended, its row is there once.

    Attributes:
        stored: Settings of the folder, including those of earlier calls.
        scenarios: Scenarios of the folder by name.

    Raises:
        ValueError: the folder contains results of other settings (the message shows the differences), or a file in it
            is damaged, or has an episode of other settings; file, line and value are named.
    """

    def __init__(self, folder: Folder, settings: Benchmark | None = None, cells: Sequence[Cell] = ()):
        """Read a folder, and add the settings and cells of a call to it; without settings, nothing is added."""
        there = read_settings(folder.path) if (folder.path / SETTINGS).exists() else None
        if there is None and (folder.path / EPISODES).exists():
            raise ValueError(f"{folder.path} contains {EPISODES} but no {SETTINGS}; choose another --out")
        now = None if settings is None else as_settings(settings, cells)
        self.stored: dict[str, Any] = there or now or {}
        self._rows: dict[_Key, dict[str, Any]] = {}
        self._detections: dict[_Key, dict[str, Any]] = {}
        self._journals: list[Journal] = []
        if self.stored != (there or {}):
            self._write(folder)  # before the episodes, which are useless without it
        try:
            self._episodes = self._open(folder, EPISODES, self._wrong_row, self._rows)
            self._times = self._open(folder, DETECTIONS, _refusal_of_detections, self._detections)
            if there is not None and now is not None:
                self.stored = self._extended(folder.path, there, now)
                if self.stored != there:
                    self._write(folder)
            self.scenarios = _scenarios_of(folder.path, self.stored)
        except BaseException:
            self.close()
            raise

    def _open(
        self, folder: Folder, name: str, refusal: Callable[[Any], str | None], entries: dict[_Key, dict[str, Any]]
    ) -> Journal:
        """Open a journal and read its entries, which a function refuses."""
        journal = folder.journal(name)
        self._journals.append(journal)
        for line, entry in enumerate(journal.entries, start=1):
            if wrong := refusal(entry):
                raise ValueError(f"{journal.path}, line {line}: {wrong}; delete that line to play its episode again")
            entries[_key(entry)] = entry | {name: math.nan for name in entry if entry[name] is None}
        return journal

    def _write(self, folder: Folder) -> None:
        folder.write(SETTINGS, json.dumps(self.stored | {"digest": _digest(self.stored)}, indent=2) + "\n")

    def _wrong_row(self, row: Any) -> str | None:
        """Return the rule that a row violates, also that it is of an episode of the settings which is there once."""
        stored = self.stored
        scenario = row.get("scenario") if isinstance(row, dict) else None
        extensions = stored["scenarios"].get(scenario, {}).get("extensions", ()) if isinstance(scenario, str) else ()
        wrong = refusal_of(row, [extension["name"] for extension in extensions if extension["kind"] == "score column"])
        if wrong is not None:
            return wrong
        if row["policy"] not in stored["policies"].get(row["scenario"], []):
            return f"is an episode of {row['policy']!r} on {row['scenario']!r}, which settings.json does not name"
        if row["episode"] >= stored["episodes"]:
            return f"is episode {row['episode']} of {stored['episodes']}"
        if row["seed"] != stored["seed"] + row["episode"]:
            return f"must have seed {stored['seed'] + row['episode']}, got {row['seed']}"
        return "is an episode that the folder already contains" if _key(row) in self._rows else None

    def _extended(self, folder: Path, there: dict[str, Any], now: dict[str, Any]) -> dict[str, Any]:
        """Return the settings of a folder with those of a call; scenarios, policies and episodes may be added.

        The code of a policy may change as long as the folder has no episode of it, so a policy that failed can be
        mended.
        """
        both = [name for name in now["scenarios"] if name in there["scenarios"]]
        begun = {policy for _, policy, _ in self._rows}
        played = [
            name
            for name in now["played"]
            if name in there["played"] and (name in begun or name.startswith((_ROBOTS, _ROGUES)))
        ]
        then, wanted = (
            {name: of[name] for name in _FIXED}
            | {"scenarios": {name: of["scenarios"][name] for name in both}}
            | {"played": {name: of["played"][name] for name in played}}
            for of in (there, now)
        )
        if differing := _differences(then, wanted):
            raise ValueError(_refusal(folder, differing))
        policies = {
            name: list(dict.fromkeys([*there["policies"].get(name, []), *now["policies"].get(name, [])]))
            for name in {**there["policies"], **now["policies"]}
        }
        return {
            "policies": policies,
            "episodes": max(there["episodes"], now["episodes"]),
            **{name: there[name] for name in _FIXED},
            "digests": now["digests"] | there["digests"],
            "played": there["played"] | {name: of for name, of in now["played"].items() if name not in played},
            "scenarios": now["scenarios"] | there["scenarios"],
        }

    def missing(self, cell: Cell, episodes: int) -> list[int]:
        """Return the numbers of those of the first `episodes` episodes of a cell that have not been played."""
        name = cell.scenario.name
        return [k for k in range(episodes) if (name, cell.policy, k) not in self._rows]

    def add(self, batch: Batch) -> None:
        """Add episodes that have ended; they are on the disk when this returns."""
        # The rows last: an episode without a row is played again.
        self._times.append(batch.detections)
        self._episodes.append(plain(batch.rows))
        self._detections |= {_key(entry): entry for entry in batch.detections}
        self._rows |= {_key(row): row for row in batch.rows}

    def of(self, cells: Iterable[Cell], episodes: int) -> list[dict[str, Any]]:
        """Return the rows of the first episodes of some cells, by scenario, policy and episode."""
        keys = [(cell.scenario.name, cell.policy, k) for cell in cells for k in range(episodes)]
        return [self._rows[key] for key in keys if key in self._rows]

    def rows(self) -> list[dict[str, Any]]:
        """Return all rows, by scenario, policy and episode, in the order of the folder's settings."""
        places = [(scenario, policy) for scenario, policies in self.stored["policies"].items() for policy in policies]
        order = {place: k for k, place in enumerate(places)}
        return [self._rows[key] for key in sorted(self._rows, key=lambda key: (order[key[:2]], key[2]))]

    def curves(self) -> dict[str, dict[str, Curve]]:
        """Return the share of the targets that is detected over time, by scenario and policy."""
        pooled: dict[str, dict[str, tuple[list[float], list[float]]]] = {}
        for row in self.rows():
            found, unfound = pooled.setdefault(row["scenario"], {}).setdefault(row["policy"], ([], []))
            entry = self._detections.get(_key(row), {"found": [], "unfound": []})
            found += entry["found"]
            unfound += entry["unfound"]
        return {name: {policy: share_detected(*times) for policy, times in of.items()} for name, of in pooled.items()}

    def close(self) -> None:
        """Close the files."""
        for journal in self._journals:
            journal.close()

    def __enter__(self) -> "Results":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def as_settings(settings: Benchmark, cells: Sequence[Cell]) -> dict[str, Any]:
    """Return all that the scores depend on, as plain values."""
    scenarios = {cell.scenario.name: cell.scenario for cell in cells}
    return plain({
        "policies": {name: [c.policy for c in cells if c.scenario.name == name] for name in scenarios},
        "episodes": settings.episodes,
        "seed": settings.seed,
        "device": settings.device,
        "versions": versions(),
        "digests": {name: scenario.digest() for name, scenario in scenarios.items()},
        "scenarios": {name: scenario.to_dict() for name, scenario in scenarios.items()},
        "played": _played(cells),
    })  # fmt: skip


def _played(cells: Sequence[Cell]) -> dict[str, dict[str, str]]:
    """Return digests of the code of each policy, of each model of robots that is not ours, and of learned rogues."""
    kinds = {cell.scenario.robot.kind for cell in cells}
    models = {_ROBOTS + kind: parts_of(model_of(kind).move) for kind in sorted(kinds) if not is_shipped(kind)}
    adversaries = {name for cell in cells for name in members_of(cell.scenario.targets.rogues or "")}
    folders = {name: folder_of(name) for name in sorted(adversaries)}
    learned = {_ROGUES + name: registry.parts(str(folder)) for name, folder in folders.items() if folder is not None}
    return {cell.policy: parts(cell.factory) for cell in cells} | models | learned


def _scenarios_of(folder: Path, stored: Mapping[str, Any]) -> dict[str, Scenario]:
    """Make the scenarios in a folder's settings, by name; extensions are not imported."""
    scenarios = {}
    for name, fields in stored["scenarios"].items():
        try:
            scenarios[name] = scenario_of(fields)
        except (TypeError, ValueError, KeyError, AttributeError) as error:
            raise _damaged(folder, f"scenarios.{name}: {error}") from error
    return scenarios


def read_settings(folder: Path) -> dict[str, Any]:
    """Read the settings in a folder.

    Raises:
        ValueError: they are not as they were written by this version.
    """
    try:
        there = read_json(folder / SETTINGS)
    except ValueError as error:
        raise ValueError(f"{error}; choose another --out, or delete the folder") from error
    digest = there.pop("digest", None) if isinstance(there, dict) else None
    if digest is None or digest != _digest(there):
        by = there.get("versions") if isinstance(there, dict) else None
        raise _damaged(folder, f"it does not match its digest; it is of {by or 'no version'}, this is {versions()}")
    return there


def versions() -> dict[str, str]:
    """Return the versions on which score rows depend."""
    return {name: version(name) for name in ("lissajous-env", "warp-lang")}


def refusal_of(row: Any, brought: Sequence[str] = ()) -> str | None:
    """Return the rule that a score row violates, as JSON represents one; None for a valid row.

    Args:
        row: the row to check.
        brought: names of the columns that the scenario adds, in their order.
    """
    if tuple(row) != (*NAMES, *brought):
        return "must have the columns of a score row"
    for name in ("scenario", "policy"):
        if not isinstance(row[name], str):
            return f"{name} must be a text, got {row[name]!r}"
    for name in ("episode", "seed"):
        if not WHOLE.accepts(row[name]):
            return f"{name} must be {WHOLE.words}, got {_short(row[name])}"
    for name in (*COLUMNS, *brought):
        if wrong := column_of(name).refusal(row[name]):
            return f"{name} {wrong}, got {_short(row[name])}"
    return None


def detections_of(simulation: Simulation, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the detection times of the targets of episodes that have ended, of the first `MOST_DETECTIONS` of a cell.

    Args:
        simulation: The simulation, world k of which played the episode of row k.
        rows: Score rows of the episodes.

    Returns:
        For each row its `scenario`, `policy` and `episode`; `found` [s], the times from a target's appearance until it
        was detected; and `unfound` [s], the times for which the other targets were present.
    """
    entries = []
    for world, row in enumerate(rows):
        if row["episode"] < MOST_DETECTIONS:
            times, detected = simulation.detection_times(world)
            times = np.round(times, 6)
            values = row["scenario"], row["policy"], row["episode"], times[detected].tolist(), times[~detected].tolist()
            entries.append(dict(zip(_DETECTION, values, strict=True)))
    return entries


def _refusal_of_detections(entry: Any) -> str | None:
    """Return the rule that a line of detection times violates; None for a valid one."""
    if not isinstance(entry, dict) or tuple(entry) != _DETECTION:
        return f"must have {', '.join(_DETECTION)}"
    scenario, policy, episode, *times = entry.values()
    is_named = isinstance(scenario, str) and isinstance(policy, str)
    if not is_named or type(episode) is not int or not 0 <= episode < MOST_DETECTIONS:
        return f"must have two names and an episode below {MOST_DETECTIONS}"
    lists = all(isinstance(values, list) for values in times)
    if not lists or any(type(time) not in (int, float) or not 0 <= time <= 1e9 for values in times for time in values):
        return "must have lists of times of at least 0 [s]"
    return None


def _short(value: Any) -> str:
    """Return a value in a few words, however large it is."""
    try:
        words = repr(value)
    except ValueError:  # a whole number of more digits than Python prints
        return f"a {type(value).__name__} too long to print"
    return words if len(words) <= 60 else f"{words[:60]}..."


def _digest(stored: Mapping[str, Any]) -> str:
    return digest_of(json.dumps(stored, sort_keys=True).encode())


def _damaged(folder: Path, why: str) -> ValueError:
    return ValueError(f"{folder / SETTINGS} is damaged: {why}; choose another --out, or delete the folder")


def _key(row: Mapping[str, Any]) -> _Key:
    return row["scenario"], row["policy"], row["episode"]


def _differences(there: Any, now: Any) -> list[tuple[str, ...]]:
    """Return the entries that differ, as (dotted name, stored, now); a scenario's description does not count."""
    first, second = _flat(there), _flat(now)
    pairs = {name: (first.get(name, "-"), second.get(name, "-")) for name in {**first, **second}}
    return [
        (name, *(_short(value).strip("'") for value in pair))
        for name, pair in pairs.items()
        if pair[0] != pair[1] and not (name.startswith("scenarios.") and name.endswith(".description"))
    ]


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    """Return the entries of nested objects, and of lists of objects, by dotted name."""
    if isinstance(value, list) and value and all(isinstance(entry, dict) for entry in value):
        value = dict(enumerate(value))
    if not isinstance(value, dict):
        return {name: value}
    return {
        place: inner
        for key, entry in value.items()
        for place, inner in _flat(entry, f"{name}.{key}".lstrip(".")).items()
    }


def _refusal(folder: Path, differing: list[tuple[str, ...]]) -> str:
    rows = [("", "there", "now"), *differing]
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    table = "\n".join(f"  {a:<{widths[0]}}  {b:<{widths[1]}}  {c}" for a, b, c in rows)
    of_code = all(name.startswith("played.") or ".parts." in name for name, *_ in differing)
    what = "of the same name with other code" if of_code else "of other settings"
    advice = "undo the change" if of_code else "the same settings"
    return f"{folder} contains results {what}; choose another --out or {advice}\n{table}"
