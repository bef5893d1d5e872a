"""The command `lissajous choose`: learn which patrol suits which scenario."""

import contextlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from rich import progress as bars

from baselines.benchmark.progress import bar
from lissajous_env import Scenario
from lissajous_env.console.terminal import DEFAULT_OUTPUT, Column, OutputOptions, make_console, plain, print_table
from lissajous_env.extras import missing
from lissajous_env.parameters import named
from lissajous_env.settings.checks import whole_number
from lissajous_env.storage.folder import Folder
from lissajous_env.world.columns import COLLISIONS
from training.choosing import playing
from training.choosing.candidates import GUARDS, PATROLS, PROVED
from training.choosing.chooser import FILE, Chooser, outputs
from training.choosing.features import FEATURES, numbers_of
from training.scenarios import EVALUATED, LEARNED, without_warnings

_TABLE = "table.jsonl"
_MARGIN = 1.0
"""Largest distance of a number of a scenario from those of the space and its shifts, as a share of their range."""


def choose(
    space: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="[SPACE]", help_behavior_hint="")] = (
        "monitoring-v1"
    ),
    objective: Literal["detection", "guarantee"] = "detection",
    scenarios: int = 400,
    evaluation_scenarios: int = 64,
    episodes: int = 8,
    rehearsed: int = 5,
    proved: bool = False,
    seed: int = 0,
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/choice"),
    output: OutputOptions = DEFAULT_OUTPUT,
) -> None:
    """Play many patrols on scenarios of a space, and learn to choose the best one for a scenario from its numbers.

    The folder is accepted wherever a policy name is. It also stores the results of the patrols: the same command
    continues after an interruption, and with another seed or more scenarios it plays only what is missing. The defaults
    take about 20 minutes on two cores.

    Example:
        lissajous choose lab.toml --scenarios 200 --out runs/lab

    Args:
        space: space of scenarios with cars, by its name or .toml file; scenarios of its split `train` are played. By
            default monitoring-v1.
        objective: time that the chosen patrol makes short: `detection`, the mean detection time, or `guarantee`, the
            worst-case undetected time.
        scenarios: number of scenarios of the split `train`.
        evaluation_scenarios: number of scenarios of the split `validation`, on which the choice is compared with each
            patrol alone.
        episodes: episodes of each patrol in each scenario.
        rehearsed: number of patrols that are played in simulation when a policy is made: 4 episodes of each, then 16 of
            the two best, of which the better one is chosen. They are those among which, given the errors of the
            network, the best one is most likely. For a scenario with a number outside of the range of the training they
            are twice as many. With 0 the network chooses alone.
        proved: True to choose among patrols with the proved collision filter; for the detection time only.
        seed: seed of the network.
        out: folder of the results.
        output: Console output.
    """
    try:
        from training.choosing.fitting import errors, fit
    except ImportError as error:
        raise missing("choose", "train", error) from error

    for name, value in (("scenarios", scenarios), ("evaluation_scenarios", evaluation_scenarios)):
        whole_number(name, value, 2)
    whole_number("episodes", episodes)
    whole_number("rehearsed", rehearsed, 0)
    whole_number("seed", seed, 0)
    drawn_from = named.scenario_space(space)
    if proved and objective != playing.DETECTION:
        raise ValueError(f"proved must be False for the objective {objective}; give a chosen folder the ending -proved")
    candidates = GUARDS if objective == playing.GUARANTEE else PROVED if proved else PATROLS
    given = {"space": space, "objective": objective, "scenarios": scenarios, "episodes": episodes, "proved": proved,
             "seed": seed}  # fmt: skip
    with without_warnings(drawn_from), Folder(out, (FILE, _TABLE)) as folder:
        learned, evaluated, *shifted = (
            playing.scenarios_of(drawn_from, split, count, objective)
            for split, count in ((LEARNED, scenarios), (EVALUATED, evaluation_scenarios),
                                 *((shift, scenarios) for shift in drawn_from.shifts))
        )  # fmt: skip
        with contextlib.closing(folder.journal(_TABLE)) as journal, _bar(output) as shown:
            task = shown.add_task("scenarios", total=len(learned) + len(evaluated))
            found = playing.table(
                candidates, [*learned, *evaluated], episodes, objective, journal, lambda: shown.advance(task)
            )
        numbers = np.array([numbers_of(each) for each in learned])
        low, high = _range([*numbers, *(numbers_of(each) for split in shifted for each in split)])
        costs = playing.costs(found, candidates, learned)
        chooser = Chooser(
            network=fit(numbers, costs, seed),
            features=tuple(FEATURES),
            candidates=candidates,
            limits=_pairs(low - _MARGIN * (high - low), high + _MARGIN * (high - low)),
            seen=_pairs(*_range(numbers)),
            about=given,
            home=plain(learned[0].resolve().to_dict()),
            rehearsed=rehearsed,
            errors=errors(numbers, costs, seed) if rehearsed > 0 else np.empty((0, 0)),
        )
        folder.write(FILE, json.dumps(chooser.to_dict(), allow_nan=False) + "\n")
    rows = _compared(chooser, found, evaluated)
    titles = "patrol", "time over the\nnetwork's choice", "collisions\nper episode", "chosen for\n[% of scenarios]"
    print_table(output.console(), [Column(titles[0], prose=True), *map(Column, titles[1:])], _in_words(rows))
    output.print(f"{len(evaluated)} scenarios of {space}:{EVALUATED}, without rehearsals; times: geometric means")
    output.print(f"Wrote {out / FILE}")
    output.print_json({"out": out, "patrols": rows})


def _bar(output: OutputOptions) -> bars.Progress:
    return bar(make_console(stderr=True, quiet=output.quiet), bars.TextColumn("{task.description}"),
               bars.MofNCompleteColumn())  # fmt: skip


def _range(numbers: Sequence[np.ndarray] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.min(numbers, axis=0), np.max(numbers, axis=0)


def _pairs(low: np.ndarray, high: np.ndarray) -> tuple[tuple[float, float], ...]:
    return tuple(zip(low.tolist(), high.tolist(), strict=True))


def _compared(chooser: Chooser, found: playing.Table, scenarios: Sequence[Scenario]) -> list[dict[str, Any]]:
    """Return each candidate's time over that of the network's choice, and collisions, the shortest first."""
    times, collisions = playing.as_arrays(found, chooser.candidates, scenarios)
    every = np.arange(len(scenarios))
    picked = np.array([int(np.argmax(outputs(chooser.network, numbers_of(each)))) for each in scenarios])
    ratios = np.log(times / times[every, picked][:, None])
    rows = [
        _row(each.name, np.exp(ratios[:, k].mean()), collisions[:, k].mean(), np.mean(picked == k))
        for k, each in enumerate(chooser.candidates)
    ]
    rows.sort(key=lambda row: row["time"])
    return [_row("the network's choice", 1.0, collisions[every, picked].mean(), 1.0), *rows]


def _row(patrol: str, time: float, collisions: float, chosen: float) -> dict[str, Any]:
    return {"patrol": patrol, "time": float(time), COLLISIONS.name: float(collisions), "chosen": float(chosen)}


def _in_words(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    return [
        [row["patrol"], f"{row['time']:.2f}", f"{row[COLLISIONS.name]:.2f}", f"{100 * row['chosen']:.0f}"]
        for row in rows
    ]
