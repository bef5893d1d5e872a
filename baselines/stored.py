"""What a benchmark keeps on the disk while it runs: its settings, and the episodes that have ended."""

import json
import math
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lissajous_env.files import read_json
from lissajous_env.folder import Folder
from lissajous_env.score import COLUMNS

if TYPE_CHECKING:
    from baselines.benchmark import Benchmark, Cell

TEXT_COLUMNS = ("scenario", "policy")
NUMBER_COLUMNS = tuple(name for name in COLUMNS if name not in (*TEXT_COLUMNS, "episode", "seed"))
"""Columns of a score row that statistics are made of."""


NAMES = ("settings.json", "episodes.jsonl")
"""Files that are kept."""


def keep_settings(folder: Folder, settings: "Benchmark", cells: Sequence["Cell"]) -> None:
    """Write the settings beside the results; where there are some, they must agree. More episodes are an extension.

    Raises:
        ValueError: the folder holds results of other settings; the message shows where they differ.
    """
    path = folder.path / "settings.json"
    now = as_settings(settings, cells)
    if path.exists():
        try:
            there = read_json(path)
            episodes_there = int(there["episodes"])
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{path} is damaged ({error}); take another --out, or delete the folder") from error
        differing = _differences(there | {"episodes": 0}, now | {"episodes": 0})
        if episodes_there > settings.episodes:
            differing.append(("episodes", str(episodes_there), str(settings.episodes)))
        if differing:
            raise ValueError(_refusal(folder.path, differing))
        if episodes_there == settings.episodes:
            return
    elif (folder.path / "episodes.jsonl").exists():
        raise ValueError(
            f"{folder.path} holds episodes.jsonl but no settings.json, so it cannot go on; take another --out"
        )
    folder.write("settings.json", json.dumps(now, indent=2) + "\n")


def as_settings(settings: "Benchmark", cells: Sequence["Cell"]) -> dict[str, Any]:
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
    })  # fmt: skip


def open_episodes(folder: Folder, settings: "Benchmark", cells: Sequence["Cell"]) -> "Episodes":
    """Open the episodes that a folder holds, to add the others to them."""
    return Episodes(folder, settings, cells)


class Episodes:
    """The score rows of the episodes that have ended, each on the disk once.

    Raises:
        ValueError: the file is damaged or holds an episode that is none of this benchmark's; file and line are named.
    """

    def __init__(self, folder: Folder, settings: "Benchmark", cells: Sequence["Cell"]):
        self._settings = settings
        self._rows: dict[tuple[str, str, int], dict[str, Any]] = {}
        self._journal = folder.journal("episodes.jsonl")
        asked = {(cell.scenario.name, cell.policy) for cell in cells}
        try:
            for line, row in enumerate(self._journal.entries, start=1):
                wrong = self._what_is_wrong(row, asked)
                if wrong:
                    raise ValueError(
                        f"{self._journal.path}, line {line} {wrong}; delete that line to have its episode played again"
                    )
                self._rows[_key(row)] = row | {c: math.nan for c in NUMBER_COLUMNS if row[c] is None}
        except ValueError:
            self._journal.close()
            raise

    def __len__(self) -> int:
        return len(self._rows)

    def missing(self, cell: "Cell") -> list[int]:
        """Numbers of the episodes of a cell that are not there yet."""
        name = cell.scenario.name
        return [k for k in range(self._settings.episodes) if (name, cell.policy, k) not in self._rows]

    def add(self, rows: list[dict[str, Any]]) -> None:
        """Add episodes that have ended; they are on the disk when this returns."""
        self._journal.append(plain(rows))
        self._rows |= {_key(row): row for row in rows}

    def in_order(self, cells: Sequence["Cell"]) -> list[dict[str, Any]]:
        """All rows, by scenario, policy and episode."""
        keys = [(c.scenario.name, c.policy, k) for c in cells for k in range(self._settings.episodes)]
        return [self._rows[key] for key in keys if key in self._rows]

    def _what_is_wrong(self, row: dict[str, Any], asked: set[tuple[str, str]]) -> str | None:
        if tuple(row) != COLUMNS:
            return "must have the columns of a score row"
        for name in COLUMNS:
            given = row[name]
            kinds = (str,) if name in TEXT_COLUMNS else (int,) if name in ("episode", "seed") else (int, float)
            if not (isinstance(given, kinds) or (given is None and name in NUMBER_COLUMNS)) or given is True:
                return f"must hold a {'word' if kinds == (str,) else 'number'} as {name}, got {given!r}"
        if (row["scenario"], row["policy"]) not in asked:
            return f"is an episode of {row['policy']} on {row['scenario']}, which was not asked for"
        if not 0 <= row["episode"] < self._settings.episodes:
            return f"is episode {row['episode']} of {self._settings.episodes}"
        if row["seed"] != self._settings.seed + row["episode"]:
            return f"must have seed {self._settings.seed + row['episode']}, got {row['seed']}"
        return "is an episode that is there already" if _key(row) in self._rows else None

    def __enter__(self) -> "Episodes":
        return self

    def __exit__(self, *_: object) -> None:
        self._journal.close()


def plain(value: Any) -> Any:
    """Turn a value into what JSON can hold: NaN becomes null, infinity a word."""
    if isinstance(value, dict):
        return {str(name): plain(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value if isinstance(value, (str, int, float, bool, type(None))) else str(value)


def _key(row: dict[str, Any]) -> tuple[str, str, int]:
    return row["scenario"], row["policy"], row["episode"]


def _differences(there: Any, now: Any, name: str = "") -> list[tuple[str, str, str]]:
    """Entries that differ, as (dotted name, there, now); a scenario's hash and words say no more than its fields."""
    if isinstance(there, dict) and isinstance(now, dict):
        names = [*there, *(key for key in now if key not in there)]
        skipped = ("digests", "description")
        inside = [(there.get(key, "-"), now.get(key, "-"), key) for key in names if key not in skipped]
        return [found for a, b, key in inside for found in _differences(a, b, f"{name}.{key}".lstrip("."))]
    return [] if there == now else [(name, _in_words(there), _in_words(now))]


def _in_words(value: Any) -> str:
    if isinstance(value, dict):
        return "..."
    words = isinstance(value, list) and all(isinstance(entry, str) for entry in value)
    return ", ".join(value) if words else str(value)


def _refusal(folder: Path, differing: list[tuple[str, str, str]]) -> str:
    rows = [("", "there", "now"), *differing]
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    table = "\n".join(f"  {a:<{widths[0]}}  {b:<{widths[1]}}  {c}" for a, b, c in rows)
    return f"{folder} holds results of other settings; take another --out or the same settings\n{table}"
