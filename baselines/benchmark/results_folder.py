"""The settings of a benchmark and the episodes that have ended, on the disk.

A folder can grow: by scenarios, policies and episodes. What is there already stays as it is, so all else must agree.
"""

import contextlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from baselines.benchmark import detections
from baselines.benchmark.rows import numbers_of, refusal_of, short
from baselines.benchmark.types import Batch, Benchmark, Cell
from baselines.policies import registry
from baselines.policies.factories import parts
from lissajous_env.console.terminal import plain
from lissajous_env.identity import parts_of
from lissajous_env.parameters.robot_models import is_shipped, model_of
from lissajous_env.parameters.rogues import folder_of, members_of
from lissajous_env.parameters.scenario import Scenario, digest_of
from lissajous_env.parameters.scenario_file import scenario_of
from lissajous_env.storage.files import read_json
from lissajous_env.storage.folder import Folder

_ENTRIES = {"policies": dict, "episodes": int, "seed": int, "device": str, "versions": dict, "digests": dict,
            "scenarios": dict, "played": dict}  # fmt: skip
"""Entries of settings.json with their types."""


NAMES = ("settings.json", "episodes.jsonl", detections.NAME)
"""Files that are preserved."""
_ROBOTS, _ROGUES = "robots of kind ", "rogues "
_ADVICE = "choose another --out, or delete the folder"


def keep_settings(folder: Folder, settings: Benchmark, cells: Sequence[Cell]) -> dict[str, Any]:
    """Write the settings beside the results and return them, those of earlier calls among them.

    Other scenarios and policies are added to what is there, and so are more episodes; all else must agree. The code of
    a policy may change as long as the folder has no episode of it, so a policy that failed can be mended.

    Raises:
        ValueError: the folder contains results of other settings (the message shows the differences), or is damaged.
    """
    path = folder.path / "settings.json"
    now = as_settings(settings, cells)
    if not path.exists():
        if (folder.path / "episodes.jsonl").exists():
            raise ValueError(
                f"{folder.path} contains episodes.jsonl but no settings.json, so the benchmark cannot resume; "
                "choose another --out"
            )
        folder.write("settings.json", json.dumps(now, indent=2) + "\n")
        return now
    there = read_settings(path)
    both = [name for name in now["scenarios"] if name in there["scenarios"]]
    begun = _begun(folder)
    played = [
        name
        for name in now["played"]
        if name in there["played"] and (name in begun or name.startswith((_ROBOTS, _ROGUES)))
    ]
    fixed = ("seed", "device", "versions")
    then, wanted = (
        {name: of[name] for name in fixed}
        | {"scenarios": {name: of["scenarios"][name] for name in both}}
        | {"played": {name: of["played"][name] for name in played}}
        for of in (there, now)
    )
    if differing := _differences(then, wanted):
        raise ValueError(_refusal(folder.path, differing))
    policies = {name: list(dict.fromkeys([*there["policies"].get(name, []), *now["policies"].get(name, [])]))
                for name in {**there["policies"], **now["policies"]}}  # fmt: skip
    held = {
        "policies": policies,
        "episodes": max(there["episodes"], now["episodes"]),
        **{name: there[name] for name in fixed},
        "digests": now["digests"] | there["digests"],
        "played": there["played"] | {name: of for name, of in now["played"].items() if name not in played},
        "scenarios": there["scenarios"] | {n: of for n, of in now["scenarios"].items() if n not in both},
    }
    if held != there:
        folder.write("settings.json", json.dumps(held, indent=2) + "\n")
    return held


def as_settings(settings: Benchmark, cells: Sequence[Cell]) -> dict[str, Any]:
    """Return all that the scores depend on, as plain values."""
    scenarios = {cell.scenario.name: cell.scenario for cell in cells}
    return plain({
        "policies": {name: [c.policy for c in cells if c.scenario.name == name] for name in scenarios},
        "episodes": settings.episodes,
        "seed": settings.seed,
        "device": settings.device,
        "versions": {name: version(name) for name in ("lissajous-env", "warp-lang")},
        "digests": {name: scenario.digest() for name, scenario in scenarios.items()},
        "scenarios": {name: scenario.to_dict() for name, scenario in scenarios.items()},
        "played": _played(cells),
    })  # fmt: skip


def _begun(folder: Folder) -> set[str]:
    """Return the names of the policies of which the folder contains episodes."""
    with contextlib.closing(folder.journal("episodes.jsonl")) as journal:
        return {str(row.get("policy")) for row in journal.entries}


def _played(cells: Sequence[Cell]) -> dict[str, dict[str, str]]:
    """Return digests of the code of each policy, of each model of robots that is not ours, and of learned rogues."""
    kinds = {cell.scenario.robot.kind for cell in cells}
    models = {_ROBOTS + kind: parts_of(model_of(kind).move) for kind in sorted(kinds) if not is_shipped(kind)}
    adversaries = {name for cell in cells for name in members_of(cell.scenario.targets.rogues or "")}
    folders = {name: folder_of(name) for name in sorted(adversaries)}
    learned = {_ROGUES + name: registry.parts(str(folder)) for name, folder in folders.items() if folder is not None}
    return {cell.policy: parts(cell.factory) for cell in cells} | models | learned


def scenarios_of(folder: Path, held: Mapping[str, Any]) -> dict[str, Scenario]:
    """Make the scenarios in a folder's settings, by name.

    Raises:
        ValueError: they are damaged: they cannot be made, or do not match the stored digests.
    """
    made = {}
    for name, fields in held["scenarios"].items():
        try:
            made[name] = scenario_of(fields)
            # Extensions are identified by the stored entries; they are not imported.
            digest = digest_of(made[name].to_dict() | {"extensions": fields["extensions"]})
        except (TypeError, ValueError, KeyError, AttributeError, RecursionError) as error:
            raise _damaged(folder / "settings.json", f"scenarios.{name}: {error}") from error
        if made[name].name != name or digest != held["digests"][name]:
            raise _damaged(folder / "settings.json", f"scenarios.{name} does not match its digest")
    return made


class Episodes:
    """The score rows of the episodes that have ended, each on the disk once; `detections`, the times of their targets.

    Raises:
        ValueError: the file is damaged or contains an episode of other settings; file, line and value are named.
    """

    def __init__(self, folder: Folder, held: Mapping[str, Any]):
        self._held = held
        self._rows: dict[tuple[str, str, int], dict[str, Any]] = {}
        self._journal = folder.journal("episodes.jsonl")
        try:
            for line, row in enumerate(self._journal.entries, start=1):
                wrong = refusal_of(row, self._brought(row)) or self._what_does_not_belong(row)
                if wrong:
                    raise ValueError(
                        f"{self._journal.path}, line {line}: {wrong}; delete that line to play its episode again"
                    )
                self._rows[_key(row)] = row | {c: math.nan for c in numbers_of(row) if row[c] is None}
            self.detections = detections.Detections(folder)
        except ValueError:
            self._journal.close()
            raise

    def __len__(self) -> int:
        return len(self._rows)

    def missing(self, cell: Cell, episodes: int) -> list[int]:
        """Return the numbers of those of the first `episodes` episodes of a cell that have not been played."""
        name = cell.scenario.name
        return [k for k in range(episodes) if (name, cell.policy, k) not in self._rows]

    def add(self, batch: Batch) -> None:
        """Add episodes that have ended; they are on the disk when this returns."""
        # The rows last: an episode without a row is played again.
        self.detections.add(batch.detections)
        self._journal.append(plain(batch.rows))
        self._rows |= {_key(row): row for row in batch.rows}

    def of(self, cells: Iterable[Cell], episodes: int) -> list[dict[str, Any]]:
        """Return the rows of the first episodes of some cells, by scenario, policy and episode."""
        keys = [(c.scenario.name, c.policy, k) for c in cells for k in range(episodes)]
        return [self._rows[key] for key in keys if key in self._rows]

    def all(self) -> list[dict[str, Any]]:
        """Return all rows, by scenario, policy and episode, in the order of the folder's settings."""
        places = [(s, p) for s, policies in self._held["policies"].items() for p in policies]
        order = {place: k for k, place in enumerate(places)}
        return [self._rows[key] for key in sorted(self._rows, key=lambda key: (order[key[:2]], key[2]))]

    def _brought(self, row: Any) -> list[str]:
        """Return the columns that the scenario of a row adds."""
        name = row.get("scenario") if isinstance(row, dict) else None
        held = self._held["scenarios"].get(name, {}) if isinstance(name, str) else {}
        return [each["name"] for each in held.get("extensions", ()) if each["kind"] == "score column"]

    def _what_does_not_belong(self, row: dict[str, Any]) -> str | None:
        held = self._held
        if row["policy"] not in held["policies"].get(row["scenario"], []):
            return f"is an episode of {row['policy']!r} on {row['scenario']!r}, which settings.json does not name"
        if row["episode"] >= held["episodes"]:
            return f"is episode {row['episode']} of {held['episodes']}"
        if row["seed"] != held["seed"] + row["episode"]:
            return f"must have seed {held['seed'] + row['episode']}, got {row['seed']}"
        return "is an episode that the folder already contains" if _key(row) in self._rows else None

    def __enter__(self) -> "Episodes":
        return self

    def __exit__(self, *_: object) -> None:
        self._journal.close()
        self.detections.close()


def read_settings(path: Path) -> dict[str, Any]:
    """Read the settings in a folder.

    Raises:
        ValueError: they are damaged; the message names the entry.
    """
    try:
        there = read_json(path)
    except ValueError as error:
        raise ValueError(f"{error}; {_ADVICE}") from error
    if not isinstance(there, dict) or set(there) != set(_ENTRIES):
        raise _damaged(path, f"it must contain {', '.join(_ENTRIES)}")
    for name, kind in _ENTRIES.items():
        if type(there[name]) is not kind or (kind is int and not 0 <= there[name] < 2**31):
            raise _damaged(path, f"{name} is {short(there[name])}")
    entries = there["policies"].values(), there["digests"].values(), there["scenarios"].values()
    for name, of, kind in zip(("policies", "digests", "scenarios"), entries, (list, str, dict), strict=True):
        if set(there[name]) != set(there["policies"]) or not all(type(entry) is kind for entry in of):
            raise _damaged(path, f"{name} is {short(there[name])}")
    words = [word for parts in there["played"].values() for word in (parts.values() if type(parts) is dict else [None])]
    policies = [policy for of in there["policies"].values() for policy in of]
    if not all(isinstance(policy, str) for policy in policies):
        raise _damaged(path, f"policies is {short(there['policies'])}")
    if set(policies) - set(there["played"]) or not all(isinstance(word, str) for word in words):
        raise _damaged(path, f"played is {short(there['played'])}")
    return there


def _damaged(path: Path, why: str) -> ValueError:
    return ValueError(f"{path} is damaged: {why}; {_ADVICE}")


def _key(row: Mapping[str, Any]) -> tuple[str, str, int]:
    return row["scenario"], row["policy"], row["episode"]


def _differences(there: Any, now: Any, name: str = "") -> list[tuple[str, str, str]]:
    """Return the entries that differ, as (dotted name, stored, now); a scenario's description does not count."""
    if isinstance(there, dict) and isinstance(now, dict):
        names = [*there, *(key for key in now if key not in there)]
        names = [key for key in names if key != "description" or "played." in name or name.endswith(".parts")]
        inside = [(there.get(key, "-"), now.get(key, "-"), key) for key in names]
        return [found for a, b, key in inside for found in _differences(a, b, f"{name}.{key}".lstrip("."))]
    alike = isinstance(there, list) and isinstance(now, list) and len(there) == len(now)
    if alike and all(isinstance(each, dict) for each in (*there, *now)):
        pairs = zip(there, now, strict=True)
        return [found for k, (a, b) in enumerate(pairs) for found in _differences(a, b, f"{name}.{k}")]
    return [] if there == now else [(name, _in_words(there), _in_words(now))]


def _in_words(value: Any) -> str:
    return "..." if isinstance(value, dict) else short(value).strip("'")


def _refusal(folder: Path, differing: list[tuple[str, str, str]]) -> str:
    rows = [("", "there", "now"), *differing]
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    table = "\n".join(f"  {a:<{widths[0]}}  {b:<{widths[1]}}  {c}" for a, b, c in rows)
    of_code = all(name.startswith("played.") or ".parts." in name for name, *_ in differing)
    what = "of the same name with other code" if of_code else "of other settings"
    advice = "undo the change" if of_code else "the same settings"
    return f"{folder} contains results {what}; choose another --out or {advice}\n{table}"
