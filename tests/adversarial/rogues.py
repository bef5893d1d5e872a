"""Rogues that know the robots' future: their ways are checked in NumPy, and by the simulation's own detection."""

import numpy as np

import baselines
import lissajous_env
from lissajous_env.episodes.missed import MissedRogue, missed_rogues
from tests.adversarial import Attack
from tests.reference_missed_rogue import fault_of

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


def missed_by_random_policy(draw: np.random.Generator, together: int = _TOGETHER) -> list[MissedRogue]:
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
    return [rogue for rogue in missed_rogues(policy, scenario, seeds) if rogue is not None]


def broken(rogue: MissedRogue) -> str | None:
    """Return what a rogue shows to be wrong: its path, its time, or the proved bound."""
    words = fault_of(rogue)
    if words is not None:
        return words
    if rogue.undetected < rogue.path.steps * rogue.played.scenario.task.step - 1e-6:
        return f"it is detected after {rogue.undetected} s, before the end of its path"
    if rogue.undetected > rogue.proved + 1e-6:
        return f"it is undetected for {rogue.undetected} s, longer than the proved {rogue.proved} s"
    return None


def rogues(draw: np.random.Generator) -> str | None:
    """Let rogues be undetected for as long as they can in a batch of episodes."""
    for rogue in missed_by_random_policy(draw):
        words = broken(rogue)
        if words is not None:
            return f"{rogue.policy} on {rogue.played.scenario.name}, seed {rogue.played.seed}: {words}"
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
