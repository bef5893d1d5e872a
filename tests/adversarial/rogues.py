"""Rogues that know the robots' future: their ways are checked in NumPy, and by the simulation's own detection."""

import numpy as np

import baselines
import lissajous_env
from lissajous_env.episodes.witness import Witness, witnesses_of
from tests.adversarial import Attack
from tests.reference_witness import fault_of

SETTINGS: tuple[tuple[str, dict], ...] = (
    ("evaders", {}),
    ("evaders-failure", {}),
    ("team", {}),
    ("redundant", {}),
    ("intruders", {"task.contamination": (90, 40)}),
    ("experiment", {"task.contamination": (90, 40), "sensing.radius": 0.6}),
    ("failure", {"task.contamination": (72, 32), "sensing.radius": 0.55}),
    ("rough", {"task.contamination": (90, 40), "sensing.radius": 0.7}),
)
POLICIES = "kuramoto", "open-loop", "tracked-reference", "kuramoto-mpcc", "open-loop-mpcc", "kuramoto-gvf", "random"
POLICIES = (*POLICIES, "sweep", "laps", "still", "open-loop-mpcc-safe")
_TOGETHER = 4
_PLAYED = 8.0, 25.0
"""Least and greatest duration [s]."""
_ENTRIES = "inside", "boundary", "unseen"


def witnesses(draw: np.random.Generator, together: int = _TOGETHER) -> list[Witness]:
    """Return rogues of a random scenario, speed limit and classical policy."""
    name, overrides = SETTINGS[draw.integers(len(SETTINGS))]
    base = lissajous_env.scenario(name, **overrides)
    speed = base.rogue_speed * draw.uniform(1.0, 3.0)
    radius = base.sensing_radius * draw.uniform(0.85, 1.15)
    chosen = {"targets.speed_limit": speed, "sensing.radius": radius}
    chosen |= {"task.duration": float(round(draw.uniform(*_PLAYED), 1)), "targets.entry": str(draw.choice(_ENTRIES))}
    scenario = lissajous_env.scenario(name, **{**overrides, **chosen})
    known = [each for each in POLICIES if each in baselines.names(scenario)]
    policy = baselines.make(str(draw.choice(known)), scenario, together)
    seeds = [int(seed) for seed in draw.integers(2**31 - 2, size=together)]
    found = witnesses_of(policy, scenario, seeds)
    return [each for each in found if each is not None]


def broken(witness: Witness) -> str | None:
    """Return what a rogue shows to be wrong: its way, its time, or the proved bound."""
    step, way = witness.played.scenario.task.step, witness.way
    words = fault_of(witness)
    if words is not None:
        return words
    if witness.undetected < (way.unseen_until - way.appears_at) * step - 1e-6:
        return f"it is detected after {witness.undetected} s, before the end of its way"
    if witness.undetected > witness.proved + 1e-6:
        return f"it is undetected for {witness.undetected} s, longer than the proved {witness.proved} s"
    return None


def rogues(draw: np.random.Generator) -> str | None:
    """Let rogues be undetected for as long as they can in a batch of episodes."""
    for each in witnesses(draw):
        words = broken(each)
        if words is not None:
            return f"{each.policy} on {each.played.scenario.name}, seed {each.played.seed}: {words}"
    return None


ATTACKS = [
    Attack(
        "rogues that know the future",
        "A rogue respects the speed limit and the walls, the simulation detects it at the end of its path, and none "
        "exceeds the bound of `task.conservative`.",
        24,
        rogues,
    )
]
