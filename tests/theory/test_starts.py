"""Warnings about starts from which cars collide whatever they do."""

import warnings

import numpy as np
import pytest

import baselines
import lissajous_env
from lissajous_env.parameters import assumptions
from lissajous_env.parameters.assumptions import AssumptionWarning, violations
from lissajous_env.theory import starts

EMPTY = {
    "targets.count": 0, "targets.arrival_rate": 0.0, "task.grid": None, "task.contamination": None,
    "faults.schedule": (), "task.duration": 4.0,
}  # fmt: skip
CROWDED = {
    "robot.count": 12, "formation.p": 6, "formation.start": "random", "robot.radius": 1.5,
    "robot.wheelbase": 1.6, "formation.phase_rate": 0.12, "task.boundary": "open",
}  # fmt: skip
RANDOM = {"formation.start": "random"}
WORLDS = 32


def made(name, **changes):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AssumptionWarning)
        return lissajous_env.scenario(name, **EMPTY | changes).resolve()


def share_of(scenario):
    arguments = scenario.driven, scenario.formation, scenario.robot
    return starts.unavoidable(*arguments, tuple(scenario.equilibrium), tuple(scenario.top_speeds))[0]


def unavoidable_in(simulation):
    """Return for each world whether a pair of its cars cannot be separated, by the rule that the warning uses."""
    scenario, robots = simulation.scenario, simulation.robots
    place = robots.position.numpy()[..., :2]
    states = np.dstack([place, robots.heading.numpy(), robots.speed.numpy()]).astype(float)
    return np.isin(np.arange(len(states)), starts.inseparable(states, scenario.robot, scenario.top_speeds))


def collides(policy, scenario):
    """Return for each world whether robots of a policy collide within four seconds, by the simulation."""
    simulation = lissajous_env.Simulation(scenario, WORLDS, seed=5)
    acting, collided = baselines.make(policy, scenario, WORLDS), np.zeros(WORLDS, bool)
    for _ in range(scenario.task.steps):
        simulation.step(acting.act(simulation.observation))
        collided |= simulation.latest.collisions.numpy().any(axis=1)
    return collided


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("experiment", RANDOM),
        ("team", {"formation.start_headway": 0.0}),
        ("hall", CROWDED | {"formation.start_headway": 0.6, "formation.start_noise": 0.3}),
    ],
)
def test_from_a_start_that_is_called_unavoidable_every_policy_collides(name, changes):
    # Oracle: the simulation, with policies that stop, turn away, or follow their paths.
    scenario = made(name, **changes)
    marked = unavoidable_in(lissajous_env.Simulation(scenario, WORLDS, seed=5))
    everyone = np.ones(WORLDS, bool)
    for policy in ("still", "still-proved", "sweep-safe", "kuramoto-mpcc-safe"):
        everyone &= collides(policy, scenario)
    assert not (marked & ~everyone).any()
    assert marked.sum() >= 0.7 * everyone.sum()
    # The drawn starts are those of the simulation: their shares differ by chance alone.
    share, seen = share_of(scenario), marked.mean()
    spread = np.sqrt(max(seen * (1 - seen), 1 / WORLDS) * (1 / WORLDS + 1 / starts.STARTS))
    assert abs(share - seen) < 4 * spread


def test_a_scenario_with_such_starts_warns_when_it_is_made(monkeypatch):
    monkeypatch.setattr(assumptions, "_reported", set())
    with pytest.warns(AssumptionWarning, match=r"no policy can avoid a collision in about \d+% of the episodes"):
        lissajous_env.scenario("hall", **CROWDED)
    # Two cars on one place, from a start without any chance.
    displaced = made("evaders", **{"formation.start_noise": 0.0, "formation.displaced": ((0, 2 * np.pi / 5),)})
    (words,) = [words for words in violations(displaced) if "start so close" in words]
    assert "about 100% of the episodes, with 1 such pairs" in words
    apart = made("hall", **CROWDED | {"formation.start_headway": 0.8, "formation.start_noise": 0.3})
    assert not [words for words in violations(apart) if "start so close" in words]
