"""The best known plans of the included scenarios, with robots that start as in the scenario: folders in `known`.

A folder is that of a plan, with the scenario as a benchmark plays it, and `found.toml`: the command that found the plan
and its figures, those of its final episodes. The folder `NAME` contains the plan with the shortest known worst-case
undetected time of whole episodes of the scenario NAME without collisions; `NAME-settled` has that of their second
halves, if it is another plan. `benchmarks/known.py` writes them.
"""

import math
import shutil
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from baselines.benchmark.standard import GRIDS
from baselines.planning.plans import SETTLED, WHOLE, Figures, Planned
from baselines.policies import stored
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import toml_value
from lissajous_env.storage.files import write_atomically

FOLDER = Path(__file__).parent / "known"
FOUND = "found.toml"


@dataclass(frozen=True)
class BestKnown:
    """A stored plan."""

    name: str
    """Name of its folder."""
    scenario: Scenario
    settings: PolicySettings
    worst_case: float
    """Worst-case undetected time of its final episodes [s]."""
    settled: float
    """The same of the second halves of these [s]."""
    command: str
    """Command that found it."""


@cache
def all_known() -> tuple[BestKnown, ...]:
    """Return all stored plans, by name."""
    found = []
    for path in sorted(FOLDER.glob(f"*/{FOUND}")):
        told = tomllib.loads(path.read_text(encoding="utf-8"))
        home = named.build(str(path.parent / stored.HOME))
        found.append(BestKnown(path.parent.name, home, stored.read(path.parent), **told))
    return tuple(found)


def known_plans(scenario: Scenario) -> list[BestKnown]:
    """Return the stored plans of a scenario; none if anything but its name and description was changed."""
    digest = scenario.digest()
    return [each for each in all_known() if each.scenario.digest() == digest]


def ranked(figures: Figures | BestKnown, goal: str) -> tuple[float, float]:
    """Return the numbers of which a plan that is better for a goal has less."""
    whole, settled = figures.worst_case, figures.settled
    return (whole, settled) if goal == WHOLE else (settled, whole)


def keep(name: str, finals: Sequence[Planned], command: str) -> list[str]:
    """Store the best plans of an included scenario, where they are better than the stored ones; return their folders.

    Args:
        name: Name of the scenario.
        finals: Plans that were played to the end on it.
        command: Command that found them.
    """
    allowed = [each for each in finals if not each.figures.collisions and math.isfinite(each.figures.worst_case)]
    written = []
    for goal, folder in ((WHOLE, name), (SETTLED, f"{name}-{SETTLED}")):
        all_known.cache_clear()  # the second goal is compared with what the first one has written
        stored_ones = [ranked(each, goal) for each in all_known() if each.name in (name, f"{name}-{SETTLED}")]
        best = min(allowed, key=lambda each: ranked(each.figures, goal), default=None)
        if best is not None and _shorter(best.figures, goal) < min(stored_ones, default=(math.inf, math.inf)):
            _write(folder, name, best, command)
            written.append(folder)
    all_known.cache_clear()
    return written


def keep_figures(stored_plan: BestKnown, figures: Figures) -> None:
    """Store figures of a stored plan in place of its own; remove the plan if it collides or has no bound."""
    if figures.collisions or not math.isfinite(figures.worst_case):
        shutil.rmtree(FOLDER / stored_plan.name)
    else:
        _write_figures(FOLDER / stored_plan.name, figures, stored_plan.command)
    all_known.cache_clear()


def _shorter(figures: Figures, goal: str) -> tuple[float, float]:
    """Return `ranked` of figures as they are stored."""
    first, second = ranked(figures, goal)
    return _short(first), _short(second)


def _write(folder: str, name: str, best: Planned, command: str) -> None:
    path = FOLDER / folder
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(parents=True)
    home = [f'name = "{folder}-best-known"', f'base = "{name}"']
    home += [f"\n[task]\ncontamination = {list(GRIDS[name])}"] if name in GRIDS else []
    write_atomically(path / stored.HOME, "\n".join(home) + "\n")
    write_atomically(path / stored.FILE, stored.as_toml(best.plan.settings))
    _write_figures(path, best.figures, command)


def _write_figures(path: Path, figures: Figures, command: str) -> None:
    found = {"command": command, "worst_case": _short(figures.worst_case), "settled": _short(figures.settled)}
    write_atomically(path / FOUND, "".join(f"{key} = {toml_value(key, value)}\n" for key, value in found.items()))


def _short(seconds: float) -> float:
    return float(f"{seconds:.6g}")
