"""The settings of a benchmark and the score rows of the episodes that have ended, on the disk.

Later calls can add scenarios, policies and episodes to a folder. Stored rows do not change, so all else must agree.
"""

import json
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from baselines.benchmark.statistics import refusal_of
from baselines.benchmark.table import Rows
from baselines.benchmark.types import Benchmark, Cell
from baselines.policies import registry
from lissajous_env.console.terminal import plain
from lissajous_env.parameters.scenario_file import scenario_of_json
from lissajous_env.storage.files import parse_json, read_bytes, undamaged
from lissajous_env.storage.folder import Folder, read_lines
from lissajous_env.wording import outside, shown

SETTINGS, EPISODES = "settings.json", "episodes.jsonl"
CSV, SUMMARY, MARKDOWN, REPORT = "episodes.csv", "summary.json", "table.md", "report.html"
FILES = (SETTINGS, EPISODES, CSV, SUMMARY, MARKDOWN, REPORT)
"""Files of the folder; the first two are stored, and all others are derived from them."""
_LARGEST = 1 << 26
"""Largest size of the settings [bytes]."""
_FIXED = ("seed", "device", "versions")
"""Entries of the settings that all calls have in common."""

_Key = tuple[str, str, int]


class Results:
    """The settings and score rows in a folder; an episode that has ended has exactly one row.

    Args:
        folder: Path of a folder that is only read, or a locked one, to which settings and episodes are added.
        settings: Settings of a call.
        cells: Its policies on scenarios.

    Attributes:
        stored: Settings of the folder, including those of earlier calls.
        scenarios: Scenarios of the folder by name.

    Raises:
        ValueError: the folder contains results of other settings (the message shows the differences), or none without
            settings; or a file in it is damaged, or has an episode of other settings (file, line and value are named).
    """

    def __init__(self, folder: Folder | Path, settings: Benchmark | None = None, cells: Sequence[Cell] = ()):
        place = folder if isinstance(folder, Path) else folder.path
        path = place / SETTINGS
        wanted = None if settings is None else as_settings(settings, cells)
        stored = parse_json(read_bytes(path, _LARGEST), path) if path.exists() else None
        if stored is None and (wanted is None or (place / EPISODES).exists()):
            raise ValueError(f"{place} must contain {SETTINGS} of a benchmark; choose another folder")
        self.stored: Any = wanted if stored is None else stored
        self._rows: dict[_Key, dict[str, Any]] = {}
        if isinstance(folder, Path):
            entries, _ = read_lines(place / EPISODES)
        else:
            if stored is None:
                self._write(folder)  # before the episodes, which are useless without it
            self._journal = folder.journal(EPISODES)
            entries = self._journal.entries
            if self._journal.torn:
                words = f"the unfinished last line of {self._journal.path} was dropped; the benchmark plays its episode"
                warnings.warn(words, RuntimeWarning, stacklevel=outside())
        try:
            self._read(place / EPISODES, entries)
            if stored is not None and wanted is not None and not isinstance(folder, Path):
                self.stored = self._extended(place, stored, wanted)
                if self.stored != stored:
                    self._write(folder)
            with undamaged(path, "file of settings"):
                self.scenarios = {name: scenario_of_json(fields) for name, fields in self.stored["scenarios"].items()}
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"{path} is damaged: {error}; choose another --out, or delete the folder") from error

    def _write(self, folder: Folder) -> None:
        folder.write(SETTINGS, json.dumps(self.stored, indent=2) + "\n")

    def _read(self, path: Path, entries: Iterable[dict[str, Any]]) -> None:
        """Read the score rows of a file, of which all must be episodes of the settings."""
        scenarios, policies = self.stored["scenarios"], self.stored["policies"]
        first, count = self.stored["seed"], self.stored["episodes"]
        for line, row in enumerate(entries, start=1):
            scenario = row.get("scenario")
            extensions = scenarios.get(str(scenario), {}).get("extensions", ())
            wrong = refusal_of(row, [entry["name"] for entry in extensions if entry["kind"] == "score column"])
            if not wrong and row["policy"] not in policies.get(scenario, []):
                wrong = f"is an episode of {row['policy']!r} on {scenario!r}, which {SETTINGS} does not name"
            elif not wrong and not (row["episode"] < count and row["seed"] == first + row["episode"]):
                wrong = f"must be one of {count} episodes from seed {first} on, got {row['episode']} of {row['seed']}"
            if wrong:
                raise ValueError(f"{path}, line {line}: {wrong}; delete that line to play its episode again")
            self._rows[_key(row)] = row | {name: math.nan for name in row if row[name] is None}

    def _extended(self, folder: Path, stored: dict[str, Any], wanted: dict[str, Any]) -> dict[str, Any]:
        """Return the settings of a folder with those of a call; scenarios, policies and episodes may be added.

        The code of a policy may change as long as the folder has no episode of it, so a policy that failed can be
        mended.
        """
        begun = {policy for _, policy, _ in self._rows}
        scenarios = [name for name in stored["scenarios"] if name in wanted["scenarios"]]
        of_others = registry.ROBOTS, registry.ROGUES
        code = [name for name in stored["played"] if name in begun or name.startswith(of_others)]
        code = [name for name in code if name in wanted["played"]]
        before, now = (
            {name: settings[name] for name in _FIXED}
            | {"scenarios": {name: settings["scenarios"][name] | {"description": ""} for name in scenarios}}
            | {"played": {name: settings["played"][name] for name in code}}
            for settings in (stored, wanted)
        )
        if before != now:
            raise ValueError(_refusal(folder, dict(_entries(before)), dict(_entries(now))))
        return {
            "policies": {
                name: list(dict.fromkeys([*stored["policies"].get(name, []), *wanted["policies"].get(name, [])]))
                for name in {**stored["policies"], **wanted["policies"]}
            },
            "episodes": max(stored["episodes"], wanted["episodes"]),
            **{name: stored[name] for name in _FIXED},
            "scenarios": wanted["scenarios"] | stored["scenarios"],
            "played": stored["played"] | {name: parts for name, parts in wanted["played"].items() if name not in code},
        }

    def missing(self, cell: Cell, episodes: int) -> list[int]:
        """Return the numbers of those of the first `episodes` episodes of a cell that have not been played."""
        return [k for k in range(episodes) if (cell.scenario.name, cell.policy, k) not in self._rows]

    def add(self, rows: Rows) -> None:
        """Add episodes that have ended; they are on the disk when this returns."""
        self._journal.append(plain(rows))
        self._rows |= {_key(row): row for row in rows}

    def of(self, cells: Iterable[Cell], episodes: int) -> Rows:
        """Return the rows of the first episodes of some cells, by scenario, policy and episode."""
        keys = [(cell.scenario.name, cell.policy, k) for cell in cells for k in range(episodes)]
        return [self._rows[key] for key in keys if key in self._rows]

    def rows(self) -> Rows:
        """Return all rows, by scenario, policy and episode, in the order of the folder's settings."""
        places = [(scenario, policy) for scenario, policies in self.stored["policies"].items() for policy in policies]
        order = {place: k for k, place in enumerate(places)}
        return [self._rows[key] for key in sorted(self._rows, key=lambda key: (order[key[:2]], key[2]))]


def as_settings(settings: Benchmark, cells: Sequence[Cell]) -> dict[str, Any]:
    """Return all that the scores depend on, as plain values."""
    scenarios = {cell.scenario.name: cell.scenario for cell in cells}
    return plain({
        "policies": {name: [c.policy for c in cells if c.scenario.name == name] for name in scenarios},
        "episodes": settings.episodes,
        "seed": settings.seed,
        "device": settings.device,
        "versions": score_versions(),
        "scenarios": {name: scenario.to_dict() for name, scenario in scenarios.items()},
        "played": registry.code_of(scenarios.values(), {cell.policy: cell.factory for cell in cells}),
    })  # fmt: skip


def score_versions() -> dict[str, str]:
    """Return the versions on which score rows depend."""
    return {name: version(name) for name in ("lissajous-env", "warp-lang")}


def _key(row: Mapping[str, Any]) -> _Key:
    return row["scenario"], row["policy"], row["episode"]


def _entries(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Return the entries of nested settings by dotted name; those of a list of objects by their places."""
    if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
        value = dict(enumerate(value))
    if isinstance(value, dict) and value:
        for key, entry in value.items():
            yield from _entries(entry, f"{name}.{key}".lstrip("."))
    else:
        yield name, value


def _refusal(folder: Path, before: dict[str, Any], now: dict[str, Any]) -> str:
    """Return the words on a folder whose settings differ from those of a call, both by dotted name."""
    names = [name for name in {**before, **now} if before.get(name, "-") != now.get(name, "-")]
    lines = [f"  {name}: {shown(before.get(name, '-'))} there, {shown(now.get(name, '-'))} now" for name in names]
    of_code = all(name.startswith("played.") or ".parts." in name for name in names)
    what = "of the same name with other code" if of_code else "of other settings"
    advice = "undo the change" if of_code else "the same settings"
    return "\n".join([f"{folder} contains results {what}; choose another --out or {advice}", *lines])
