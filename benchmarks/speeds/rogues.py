"""A step with rogues that are agents, one world and a batch, compared with mpe2 `simple_tag_v3`."""

from collections.abc import Callable

import numpy as np
from figures import Table
from timing import by_turns

import lissajous_env
from speeds import Options, Part
from speeds.step import rows_of

ROBOTS, ROGUES = 5, 5
SETTINGS = {"targets.count": ROGUES, "targets.arrival_rate": 0.0, "targets.entry": "unseen", "sensing.radius": 0.3}
TAG = "mpe2 simple_tag"


def single(rogues: str) -> Callable[[], object]:
    """Return `ParallelEnv.step` with robots that do not move; an episode is reset when a rogue is detected."""
    env = lissajous_env.parallel_env("experiment", rogues=rogues, **SETTINGS)
    actions = {agent: np.zeros(2, dtype=np.float32) for agent in env.possible_agents}

    def begin() -> None:
        env.reset()
        while len(env.agents) < len(env.possible_agents):
            env.reset()

    begin()

    def step() -> None:
        env.step(actions)
        if len(env.agents) < len(env.possible_agents):
            begin()

    return step


def batch(rogues: str, worlds: int, threads: int) -> Callable[[], object]:
    """Return `Simulation.step` of some worlds, without an end of the episode."""
    settings = SETTINGS | {"task.duration": 10_000.0, "rogues": rogues}
    simulation = lissajous_env.Simulation("experiment", num_worlds=worlds, threads=threads, **settings)
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-0.3, 0.3, simulation.action_shape).astype(np.float32)]
    if rogues == "agents":
        actions.append(rng.uniform(-1, 1, (worlds, ROGUES, 2)).astype(np.float32))
    return lambda: simulation.step(*actions)


def tag() -> Callable[[], object]:
    """Return a step of mpe2 with as many chasers and as many chased."""
    from mpe2 import simple_tag_v3

    env = simple_tag_v3.parallel_env(num_good=ROGUES, num_adversaries=ROBOTS, max_cycles=10**9)
    env.reset(seed=0)
    actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    return lambda: env.step(actions)


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `rogues`."""
    often = 10 if options.quick else 200
    sides = {"rogues are agents, `ParallelEnv.step`": (single("agents"), often)}
    if options.rivals:
        sides[TAG] = (tag(), max(often // 10, 1))
    rows = rows_of(by_turns(sides, options.rounds), 1, TAG)
    sides = {
        f"batch, rogues: {name}": (batch(name, options.worlds, options.threads), 2 if options.quick else 20)
        for name in ("agents", "wander", "follow-gap")
    }
    if options.rivals:
        sides[TAG] = (tag(), max(often // 10, 1))
    times = by_turns(sides, options.rounds)
    if TAG in times:  # one world, compared with many of this package
        times[TAG] = [seconds * options.worlds for seconds in times[TAG]]
    rows += rows_of(times, options.worlds, TAG)
    columns = ["", "worlds", "step of a world [us]", "best [us]", "million steps of a world per second", "rival",
               "its step of a world [us]", "ratio"]  # fmt: skip
    return {"rogue-speed": {"columns": columns, "rows": rows}}


PART = Part(
    "rogues",
    f"a step of {ROBOTS} cars and {ROGUES} rogues that are agents, beside mpe2 `simple_tag` with the same numbers",
    tables,
    rivals={"mpe2": "bench"},
)
