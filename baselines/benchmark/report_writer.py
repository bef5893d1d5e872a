"""Write the report of a benchmark: at once without replays, and again with those that were requested."""

from collections.abc import Mapping
from typing import Any

from rich import progress as bars
from rich.console import Console

from baselines.benchmark import replays, standard, summary_files
from baselines.benchmark.progress import bar
from baselines.benchmark.report_page import Report, command_of
from baselines.benchmark.types import Cell, Outcome
from baselines.policies import registry
from baselines.policies.factories import is_ones_own, named
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import where_raised


def write_report(folder: Folder, outcome: Outcome, progress: Console) -> str:
    """Write `report.html` of all episodes of the folder, and return a line about its replays.

    It depends only on the score rows and their seeds, so that a benchmark that was interrupted has the same report.
    """
    made = summary_files.provenance(outcome.held["device"])
    report = Report(outcome.table, made, _commands(outcome), _nameless(outcome), outcome.failures, outcome.theorem)
    ranked, cells, asked = report.ranked(), playable(outcome), outcome.settings.replays
    folder.write(summary_files.REPORT, report.html(ranked, {}))
    chosen = replays.chosen(asked, ranked, cells)
    if not chosen:
        return ""
    played: dict[replays.Key, replays.Played] = {}
    failed = []
    counted = bars.TextColumn("{task.completed} replays")
    with bar(progress, bars.TextColumn("{task.description}"), counted) as shown:
        task = shown.add_task("", total=len(chosen))
        batches = replays.batches(chosen, cells, ranked, outcome.table.references())
        for cell, result in replays.make(batches, ranked, outcome.device, "few" in asked):
            shown.update(task, description=f"{cell.scenario.name} {cell.policy}")
            if isinstance(result, BaseException):
                failed.append(f"{cell.policy} on {cell.scenario.name}: {where_raised(result)}")
            else:
                played |= result
                shown.advance(task, len(result))
    folder.write(summary_files.REPORT, report.html(ranked, played))
    is_short = "few" in asked and any(key not in played for key in chosen)
    more = "; --replays each adds the best, the median and the worst of all" if is_short else ""
    said = [f"{summary_files.REPORT} plays {len(played):,} of the episodes{more}"]
    return "\n".join([*said, *(f"not replayed: {words}" for words in failed)])


def playable(outcome: Outcome) -> dict[tuple[str, str], Cell]:
    """Return the cells of this call, and those of earlier calls whose policy and scenario are unchanged."""
    cells = {(cell.scenario.name, cell.policy): cell for cell in outcome.cells}
    for name, policies in outcome.held["policies"].items():
        scenario = outcome.table.scenarios[name]
        for policy in policies:
            whole = scenario.digest() == outcome.held["digests"][name]  # no extension is missing
            known = (name, policy) not in cells and whole and policy in registry.names(scenario)
            if known and registry.parts(policy) == outcome.held["played"][policy]:
                cells[name, policy] = Cell(scenario, policy, named(policy))
    failed = {(each.scenario, each.policy) for each in outcome.failures}
    return {place: cell for place, cell in cells.items() if place not in failed}


def _commands(outcome: Outcome) -> dict[str, str]:
    """Return the name of each scenario in a command, for those with a name that leads to the same one."""
    overrides, commands = outcome.settings.overrides, {}
    for given in dict.fromkeys((*outcome.settings.scenarios, *outcome.table.scenarios)):
        try:
            scenario = standard.as_played(given, overrides)
        except (ValueError, OSError, ImportError):
            continue
        if scenario.digest() == outcome.held["digests"].get(scenario.name):
            words = command_of(given, plain_fields(standard.overrides_of(given, overrides)))
            commands.setdefault(scenario.name, words)
    return commands


def plain_fields(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the overrides that can be written on a command line."""
    return {name: value for name, value in overrides.items() if isinstance(value, (str, int, float, tuple, type(None)))}


def _nameless(outcome: Outcome) -> frozenset[str]:
    """Return the policies that were passed as Python objects, so that no command can name them."""
    policies = {policy for of in outcome.held["policies"].values() for policy in of}
    return frozenset(name for name in policies if name not in registry.names() and not is_ones_own(name))
