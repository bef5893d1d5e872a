"""Reports of planning: a table for the terminal, and folders of plans that commands play."""

import dataclasses
import json
import math
import re
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from baselines.benchmark.best_known import BEST_KNOWN as KNOWN
from baselines.benchmark.shown import Entry
from baselines.benchmark.statistics import between, number
from baselines.planning.plans import SETTLED_TIME, Planned, worst_cases
from baselines.planning.rehearse import Episodes
from baselines.planning.search import PlanOutcome
from baselines.policies.settings import POLICY_FILE, SCENARIO_FILE
from lissajous_env.console.terminal import Column, plain, print_table
from lissajous_env.parameters.scenario_file import as_toml
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import counted
from lissajous_env.world.columns import OPEN, WORST_CASE

FIGURES = "plans.json"
"""File of a folder of plans, with the figures of all."""


def print_plans(console: Any, outcome: PlanOutcome, plans: Sequence[Planned]) -> None:
    """Print a table of plans."""
    failures, bounds, episodes = outcome.request.failures, outcome.lower_bounds, f"{_played(plans)}\nepisodes"
    without_walls = any(scenario.task.boundary != "wall" for scenario in outcome.scenarios.values())

    def entries(planned: Planned) -> list[tuple[bool, Column, str]]:
        """Return whether each column is shown, the column, and the words of a plan."""
        figures, robots = planned.figures, planned.plan.scenario.num_robots
        name = planned.plan.settings.policy + (" (close)" if figures.too_close else "")
        collided = figures.collisions_failed
        failed = counted(collided, "collision") if collided else worst_in_words(planned.failed_rows)
        detection = Entry(number(figures.detection_time), between(figures.detection_low, figures.detection_high))
        return [
            (True, Column("plan", left=True), name),
            (len(outcome.scenarios) > 1, Column("N"), str(robots)),
            (True, Column(f"worst case [s]\n{episodes}"), worst_in_words(planned.rows)),
            (True, Column(f"second half [s]\n{episodes}"), worst_in_words(planned.rows, SETTLED_TIME)),
            (failures > 0, Column(f"with {_lost(outcome)} lost [s]\n{_losses(outcome)}\nepisodes"), failed),
            (True, Column("lower\nbound [s]", rank=2), number(bounds.get(robots, math.nan))),
            (True, Column("mean detection\ntime [s]", rank=1), str(detection)),
            (True, Column("least gap\n[m]", rank=2), number(figures.clearance)),
            (without_walls, Column("outside\n[m]", rank=1), number(figures.outside)),
            (True, Column("driven\n[m/min]", rank=3), number(figures.distance)),
            (True, Column("messages", left=True, rank=4), figures.messages),
            (True, Column("details", prose=True, rank=1), planned.plan.about),
        ]

    shown = [[(column, words) for is_shown, column, words in entries(planned) if is_shown] for planned in plans]
    rows = [[str(k), *(words for _, words in row)] for k, row in enumerate(shown, start=1)]
    print_table(console, [Column("", name="number"), *(column for column, _ in shown[0])], rows)


def untried_in_words(outcome: PlanOutcome) -> str:
    """Return a warning that names the families of which no plan was tried; "" if there is none."""
    if not outcome.untried:
        return ""
    remedy = "" if outcome.fewest_robots else f": {_more(outcome)} are needed"
    return f"Not tried: {', '.join(outcome.untried)}. Their plans may be better{remedy}."


def _more(outcome: PlanOutcome) -> str:
    """Return the option that extends the search."""
    return "more --plans" if outcome.request.seconds is None else "more --seconds"


def sentences(outcome: PlanOutcome) -> list[str]:
    """Return sentences on the played episodes, the meaning of the figures, and the families that have no plan."""
    episodes, has_plans = outcome.request.episodes, bool(outcome.plans)
    tried = counted(outcome.looks, "plan was tried", "plans were tried")
    words = [f"{tried}, {len(outcome.finals)} simulated to the end, in {counted(episodes.count, 'episode')} each"]
    words[0] += f", the printed ones in {_played(outcome.plans)}" if has_plans else ""
    if episodes.failures:
        count = _lost(outcome)
        lost = counted(count, "robot is removed", "robots are removed")
        all_or_some = "each combination of robots once" if count > 1 else "each robot once"
        if "of" in _losses(outcome):
            all_or_some = "of as many combinations of robots, drawn at random"
        words[0] += f", and in {_losses(outcome)} in which {lost} after a quarter of the episode ({all_or_some})"
    words[0] += f". The search took {outcome.seconds:.0f} s."
    if has_plans:
        words[0] += " A worst case is the largest time of these episodes; the median is in brackets where it differs."
        words.append("Mean detection time: with its 95 % bootstrap interval over the episodes.")
    if broken := [reason for search in outcome.searches.values() for reason in search.broken]:
        words.append(f"{counted(len(broken), 'plan')} failed in simulations to the end: {broken[0]}.")
    if has_plans and all(math.isinf(planned.figures.worst_case) for planned in outcome.plans):
        words.append("No plan has a bound on the time for which such a target can stay undetected.")
    elif has_plans and episodes.failures:
        words += _of_failures(outcome)
    if any(planned.figures.too_close for planned in outcome.plans):
        least = outcome.request.required_clearance
        words.append(f"Close: two bodies come closer than {least:.3g} m (--clearance); such plans come last.")
    if outcome.request.guarantee is not None:
        words += _of_guarantee(outcome)
    for robots, refusals in outcome.refusals.items():
        at = f" ({robots} robots)" if len(outcome.scenarios) > 1 else ""
        refusals = {family: reason.removesuffix(".") for family, reason in refusals.items() if family != KNOWN}
        words += [f"No plan of {family}{at}: {reason}." for family, reason in refusals.items()]
    return words


def _of_failures(outcome: PlanOutcome) -> list[str]:
    """Return the reasons why no plan has a bound with removed robots, and a remedy; nothing if one has."""
    if any(planned.figures.worst_case_failed < math.inf for planned in outcome.plans):
        return []
    lost, collide = _lost(outcome), sum(planned.figures.collisions_failed > 0 for planned in outcome.plans)
    plans = len(outcome.plans)
    words = f"No plan has a bound with {lost} removed: {plans - collide} of {plans} leave a gap where a target can"
    words += " stay undetected" + (f", {collide} collide" if collide else "")
    return [f"{words}. More robots or longer sensors are needed, or {_more(outcome)}."]


def _of_guarantee(outcome: PlanOutcome) -> list[str]:
    """Return the fewest robots that guarantee the requested time, and the numbers that cannot."""
    requested = f"{outcome.request.guarantee:g} s"
    too_few = {n: bound for n, bound in outcome.lower_bounds.items() if bound > (outcome.request.guarantee or 0)}
    words = [f"{n} robots cannot: the lower bound for every policy is {bound:.3g} s." for n, bound in too_few.items()]
    if (fewest := outcome.fewest_robots) is None:
        return [*words, f"No plan was found that guarantees {requested}."]
    return [*words, f"{fewest} robots are the fewest with which a plan was found that guarantees {requested}."]


def _played(plans: Sequence[Planned]) -> str:
    """Return the number of episodes without failures of some plans."""
    counts = [len(planned.rows) for planned in plans]
    return " to ".join(dict.fromkeys([str(min(counts, default=0)), str(max(counts, default=0))]))


def _lost(outcome: PlanOutcome) -> int:
    """Return the number of robots that are removed in an episode with failures; it does not depend on their number."""
    return outcome.request.episodes.lost(next(iter(outcome.scenarios.values())))


def _losses(outcome: PlanOutcome) -> str:
    """Return the number of episodes with failures, and the number of all combinations where these are a sample."""
    counts, episodes = [], outcome.request.episodes
    for robots, scenario in outcome.scenarios.items():
        played, all_of_them = len(episodes.losses(scenario)), math.comb(robots, episodes.lost(scenario))
        counts.append(str(played) if played == all_of_them else f"{played} of {all_of_them}")
    return " to ".join(dict.fromkeys([counts[0], counts[-1]]))


def worst_in_words(rows: Sequence[dict[str, Any]], name: str = WORST_CASE.name) -> str:
    """Return the largest time of some episodes by its column, with the median where it differs; a dash for no episode.

    A time that was still growing at the end is a lower bound if it is too short for its episode to be open (`OPEN`).
    """
    times = worst_cases(rows, name) or [math.nan]
    words, median = (
        "no bound" if time == math.inf else number(time) for time in (max(times), statistics.median(times))
    )
    if words == "no bound" and not any(row[OPEN.name] for row in rows):
        words = f"> {number(max(row[name] for row in rows))}"
    return words if median in (words, "no bound") else f"{words} (median {median})"


def open_folder(path: Path, most: int) -> Folder:
    """Open a folder for at most so many plans, to test before the search whether it can be written to.

    Raises:
        ValueError: it cannot be written to, or a file of a user has the name of one of the plans.
    """
    return Folder(path, [FIGURES, *(f"{k}/" for k in range(1, most + 1))])


def write(folder: Folder, plans: Sequence[Planned], episodes: Episodes) -> None:
    """Write plans as folders 1, 2 ..., and their figures; remove the plans of an earlier call."""
    for name in folder.written:
        if "/" in name and not name.endswith("/"):
            folder.remove(name)
    for k, plan in enumerate((planned.plan for planned in plans), start=1):
        name = re.sub(r"[^\w.-]", "-", plan.scenario.name).lstrip(".-")[:80] or "plan"  # for files, see `NAMES`
        words = f"Planned for {plan.settings.policy} ({plan.about})."
        renamed = dataclasses.replace(plan.scenario, name=f"{name}-{k}", description=words)
        folder.write(f"{k}/{SCENARIO_FILE}", as_toml(renamed))
        folder.write(f"{k}/{POLICY_FILE}", plan.settings.as_toml())
    folder.write(FIGURES, json.dumps(plain({"episodes": episodes, "plans": as_rows(plans)}), indent=2) + "\n")


def as_rows(plans: Sequence[Planned]) -> list[dict[str, Any]]:
    """Return plans with their figures and their score rows as plain values."""
    return [
        {
            "family": planned.plan.family,
            **dataclasses.asdict(planned.plan.settings),
            "about": planned.plan.about,
            "robots": planned.plan.scenario.num_robots,
            "figures": dataclasses.asdict(planned.figures),
            "rows": planned.rows,
            "failed_rows": planned.failed_rows,
        }
        for planned in plans
    ]
