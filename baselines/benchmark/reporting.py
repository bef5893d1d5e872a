"""Writes the report of a benchmark: at once without replays, and again with those that are asked for."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich import progress as bars
from rich.console import Console

from baselines.benchmark import page, report, standard
from baselines.benchmark.comparison import Comparisons
from baselines.benchmark.page import Report
from baselines.benchmark.progress import bar
from baselines.benchmark.replays import Key, Played, chosen, make
from baselines.benchmark.types import Cell, Outcome
from baselines.policies import registry
from baselines.policies.factories import is_ones_own, named
from lissajous_env.console.terminal import plain
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import where_raised


def write_report(folder: Folder, outcome: Outcome, comparisons: Comparisons, progress: Console) -> str:
    """Write `report.html` of all that the folder holds, and return what there is to say of its replays.

    All of it is made of the score rows and their seeds, so that a benchmark that was stopped has the same report.
    """
    cells = _playable(outcome)
    made = Report(outcome, comparisons, _made(outcome), _commands(outcome), _nameless(outcome))
    ranked = made.ranked()
    rounds = chosen(outcome.settings.replays, ranked)
    folder.write(page.NAME, made.html(ranked, {}))
    if not any(rounds):
        return ""
    hurried = "few" in outcome.settings.replays
    played, failed = _played(rounds, cells, ranked, made.references(), outcome, hurried, progress)
    folder.write(page.NAME, made.html(ranked, played))
    left = {key for keys in rounds for key in keys if key[:2] in cells} - played.keys()
    more = "; --replays each adds the best, the median and the worst of all" if hurried and left else ""
    said = [f"{page.NAME} plays {len(played):,} of the episodes{more}"]
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
    """Play what is chosen; of what failed, say in words what did."""
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


def _playable(outcome: Outcome) -> dict[tuple[str, str], Cell]:
    """Cells of this call, and those of earlier calls whose policy and scenario are known by name and unchanged."""
    cells = {(cell.scenario.name, cell.policy): cell for cell in outcome.cells}
    for name, policies in outcome.held["policies"].items():
        scenario = outcome.held_scenarios[name]
        for policy in policies:
            whole = scenario.digest() == outcome.held["digests"][name]  # nothing that it brings is missing
            known = (name, policy) not in cells and whole and policy in registry.names(scenario)
            if known and registry.parts(policy) == outcome.held["played"][policy]:
                cells[name, policy] = Cell(scenario, policy, named(policy))
    failed = {(each.scenario, each.policy) for each in outcome.failures}
    return {place: cell for place, cell in cells.items() if place not in failed}


def _commands(outcome: Outcome) -> dict[str, str]:
    """How a command names each scenario: by a name that leads to the very same one."""
    settings, found = outcome.settings, {}
    for given in dict.fromkeys((*settings.scenarios, *outcome.held_scenarios)):
        try:
            scenario = standard.as_played(given, settings.overrides)
        except (ValueError, OSError, ImportError):
            continue
        if scenario.digest() == outcome.held["digests"].get(scenario.name):
            found.setdefault(
                scenario.name, page.command_of(given, plain_fields(standard.overrides_of(given, settings.overrides)))
            )
    return found


def plain_fields(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Overrides as a command line can hold them."""
    return {name: value for name, value in overrides.items() if isinstance(value, (str, int, float, tuple, type(None)))}


def _nameless(outcome: Outcome) -> frozenset[str]:
    """Policies that were given as objects of Python, so that no command can name them."""
    policies = {policy for of in outcome.held["policies"].values() for policy in of}
    return frozenset(name for name in policies if name not in registry.names() and not is_ones_own(name))


def _made(outcome: Outcome) -> dict[str, str]:
    machine, versions = report.machine(outcome.held["device"]), report.versions()
    known = {
        "command": report.command(),
        "machine": f"{machine['cpu']}, {machine['cores']} cores, {machine['device']}",
        "versions": ", ".join(f"{name} {number}" for name, number in plain(versions).items()),
    }
    return known
