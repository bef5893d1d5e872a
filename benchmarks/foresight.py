"""Undetected times of rogues that know the robots' future: `python benchmarks/foresight.py`.

The learned and the scripted rogues of docs/rogues.md start at random. The same starts are played with foresight: robots
do not react to rogues before they detect them, so the best action in each state follows from the recorded episode, by
the dynamic programming that trainings imitate (`lissajous_env.episodes.missed.foresight`). The simulation decides when
such a rogue is detected. No rogue that observes only the present can be expected to do better, from these starts. The
table has the mean over all starts and, in brackets, that over the best start of each episode; "never detected" is the
mean time from a start to the end of its episode. `--episodes` makes it shorter, `--store` puts the table into
docs/figures.json.
"""

from collections.abc import Sequence

import figures
import numpy as np
from publish import ROGUES_HELD_OUT, SCRIPTS
from rogues import LEARNED

from baselines.policies.registry import as_factory
from lissajous_env import Scenario, Simulation
from lissajous_env.episodes.missed.foresight import Foresight, Moment
from training.learned import checkpoint
from training.rogue_trainer import undetected_times
from training.settings import RogueTraining

TITLES = ("scenario, policy", "best script [s]", "learned [s]", "with foresight [s]", "learned share of it")
TITLES = (*TITLES, "never detected [s]")
_MARGIN, _BLUR = 0.01, 0.3
"""Values with which rogues with foresight stay undetected for longest; without them, small errors lead to detection."""
_TOGETHER = 4


def with_foresight(policy: str, scenario: Scenario, seeds: Sequence[int]) -> tuple[dict[str, float], np.ndarray]:
    """Return the undetected times of rogues with foresight, and the mean time from a start to the end [s]."""
    times, left = [], []
    for first in range(0, len(seeds), _TOGETHER):
        batch = list(seeds[first : first + _TOGETHER])
        simulation = Simulation(scenario, len(batch))
        appears = _play(policy, simulation, batch)
        for world in range(len(batch)):
            times.append(simulation.detection_times(world)[0])
            there = appears[world][appears[world] < scenario.task.steps]
            left.append((scenario.task.steps - there).mean() * scenario.task.step)
    known = {"mean": np.mean([row.mean() for row in times]), "longest": np.mean([row.max() for row in times])}
    return known, np.array(left)


def _play(policy: str, simulation: Simulation, seeds: Sequence[int]) -> np.ndarray:
    """Play an episode in each world, and again with rogues that know it; return the steps at which rogues appear."""
    driver, steps = as_factory(policy)(simulation.scenario, len(seeds), "cpu"), simulation.scenario.task.steps
    resting, moments, actions = np.zeros(simulation.rogues.action.shape, np.float32), [], []
    simulation.reset(seeds=seeds)
    driver.reset()
    moments.append(Moment.of(simulation))
    for _ in range(steps):
        actions.append(np.array(driver.act(simulation.observation)))
        simulation.step(actions[-1], resting)
        moments.append(Moment.of(simulation))
    foresight = Foresight(simulation.scenario, _MARGIN, _BLUR)
    values = dict(foresight.values(moments))
    ends = np.array(sorted(values))
    simulation.reset(seeds=seeds)
    appears = simulation.targets.appears_at.numpy().copy()
    for now in range(steps):
        worlds, slots = np.nonzero(simulation.rogues.present.numpy())
        moves, end = resting.copy(), int(ends[np.searchsorted(ends, now, side="right")])
        places = simulation.targets.position.numpy()[worlds, slots]
        moves[worlds, slots] = foresight.best_actions(places, worlds, end - now, values[end])[0]
        simulation.step(actions[now], moves)
    return appears


def row_of(name: str, policy: str, learned: str, seeds: Sequence[int]) -> list[str]:
    """Return a row of the table."""
    settings = RogueTraining(name)
    by_rogue = {rogue: undetected_times(policy, settings.make_scenario(rogue), seeds) for rogue in (*SCRIPTS, learned)}
    foreseen, left = with_foresight(policy, settings.make_scenario(), seeds)
    best = {key: max(by_rogue[rogue][key] for rogue in SCRIPTS) for key in ("mean", "longest")}
    by_learned = by_rogue[learned]
    times = [f"{summary['mean']:.2f} ({summary['longest']:.1f})" for summary in (best, by_learned, foreseen)]
    return [f"`{name}`, `{policy}`", *times, f"{by_learned['mean'] / foreseen['mean']:.0%}", f"{left.mean():.1f}"]


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=len(ROGUES_HELD_OUT), help="at most 64")
    options = parser.parse_args()
    rows, seeds = [], ROGUES_HELD_OUT[: options.episodes]
    for learned, folder in LEARNED.items():
        description = checkpoint.read_description(folder)
        for policy in description["held_out_times"]:
            rows.append(row_of(description["card"].scenario, policy, learned, seeds))
            print(*rows[-1], sep=" | ", flush=True)
    table = {"columns": TITLES, "rows": rows}
    figures.publish("foresight", "foresight", table, options.store)


if __name__ == "__main__":
    main()
