"""Write the report of a benchmark: at once without replays, and again with those that were requested."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich import progress as bars
from rich.console import Console

from baselines.benchmark import report_page, standard, summary_files
from baselines.benchmark.comparison import Comparisons
from baselines.benchmark.progress import bar
from baselines.benchmark.replays import Key, Played, chosen, make
from baselines.benchmark.report_page import Report
from baselines.benchmark.types import Cell, Outcome
from baselines.policies import registry
from baselines.policies.factories import is_ones_own, named
from lissajous_env.console.terminal import plain
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import where_raised


def write_report(folder: Folder, outcome: Outcome, comparisons: Comparisons, progress: Console) -> str:
    """Write `report.html` of all episodes of the folder, and return a line about its replays.

    It depends only on the score rows and their seeds, so that a benchmark that was interrupted has the same report.
    """
    cells = playable(outcome)
    made = Report(outcome, comparisons, _made(outcome), _commands(outcome), _nameless(outcome))
    ranked = made.ranked()
    rounds = chosen(outcome.settings.replays, ranked)
    folder.write(report_page.NAME, made.html(ranked, {}))
    if not any(rounds):
        return ""
    hurried = "few" in outcome.settings.replays
    played, failed = _played(rounds, cells, ranked, made.references(), outcome, hurried, progress)
    folder.write(report_page.NAME, made.html(ranked, played))
    left = {key for keys in rounds for key in keys if key[:2] in cells} - played.keys()
    more = "; --replays each adds the best, the median and the worst of all" if hurried and left else ""
    said = [f"{report_page.NAME} plays {len(played):,} of the episodes{more}"]
    return "\n".join([*said, *(f"not replayed: {words}" for words in failed)])


def _played(
    rounds: Sequence[Sequence[Key]],
    cells: Mapping[tuple[str, str], Cell],
    ranked: Sequence[Mapping[str, Any]],
    references: Mapping[str, str],
    outcome: Outcome,
    hurried: bool,
    console: Console,
) -> tuple[dict[Key, Played], list[str]]:
    """Play the chosen episodes again; return them, and in words the failures."""
    rows = {(row["scenario"], row["policy"], row["seed"]): row for row in ranked}
    # Another machine's device may not be here.
    device = outcome.settings.device if outcome.settings.engine == "local" else "cpu"
    counted = bars.TextColumn("{task.completed} replays")
    played: dict[Key, Played] = {}
    failed: list[str] = []
    with bar(console, bars.TextColumn("{task.description}"), counted) as shown:
        task = shown.add_task("", total=len({key for keys in rounds for key in keys}))

        def begin(cell: Cell) -> None:
            shown.update(task, description=f"{cell.scenario.name} {cell.policy}")

        def fail(cell: Cell, error: BaseException) -> None:
            failed.append(f"{cell.policy} on {cell.scenario.name}: {where_raised(error)}")

        for key, episode in make(rounds, cells, rows, references, device, hurried, begin, fail):
            played[key] = episode
            shown.advance(task)
    return played, failed


def playable(outcome: Outcome) -> dict[tuple[str, str], Cell]:
    """Return the cells of this call, and those of earlier calls whose policy and scenario are unchanged."""
    cells = {(cell.scenario.name, cell.policy): cell for cell in outcome.cells}
    for name, policies in outcome.held["policies"].items():
        scenario = outcome.held_scenarios[name]
        for policy in policies:
            whole = scenario.digest() == outcome.held["digests"][name]  # no extension is missing
            known = (name, policy) not in cells and whole and policy in registry.names(scenario)
            if known and registry.parts(policy) == outcome.held["played"][policy]:
                cells[name, policy] = Cell(scenario, policy, named(policy))
    failed = {(each.scenario, each.policy) for each in outcome.failures}
    return {place: cell for place, cell in cells.items() if place not in failed}


def _commands(outcome: Outcome) -> dict[str, str]:
    """Return the name of each scenario in a command, for those with a name that leads to the same one."""
    settings, found = outcome.settings, {}
    for given in dict.fromkeys((*settings.scenarios, *outcome.held_scenarios)):
        try:
            scenario = standard.as_played(given, settings.overrides)
        except (ValueError, OSError, ImportError):
            continue
        if scenario.digest() == outcome.held["digests"].get(scenario.name):
            found.setdefault(
                scenario.name,
                report_page.command_of(given, plain_fields(standard.overrides_of(given, settings.overrides))),
            )
    return found


def plain_fields(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the overrides that can be written on a command line."""
    return {name: value for name, value in overrides.items() if isinstance(value, (str, int, float, tuple, type(None)))}


def _nameless(outcome: Outcome) -> frozenset[str]:
    """Return the policies that were passed as Python objects, so that no command can name them."""
    policies = {policy for of in outcome.held["policies"].values() for policy in of}
    return frozenset(name for name in policies if name not in registry.names() and not is_ones_own(name))


def _made(outcome: Outcome) -> dict[str, str]:
    machine, versions = summary_files.machine(outcome.held["device"]), summary_files.versions()
    known = {
        "command": summary_files.command(),
        "machine": f"{machine['cpu']}, {machine['cores']} cores, {machine['device']}",
        "versions": ", ".join(f"{name} {number}" for name, number in plain(versions).items()),
    }
    return known
