"""The reward and its terms, and the flags that end an episode."""

import dataclasses

import numpy as np
import pytest

import lissajous_env
from lissajous_env.world.state import Contamination, EpisodeTotals, StepEvents
from lissajous_env.world.tally import FORMULAS, TERMS

WEIGHTS = {
    "task.reward_detection": 2.0,
    "task.reward_waiting": -0.3,
    "task.reward_collision": -5.0,
    "task.reward_idleness": 0.7,
    "task.reward_effort": -0.2,
    "task.reward_formation": -0.4,
    "task.reward_outside": -0.9,
    "task.reward_contamination": 0.7,
    "task.reward_observation": 0.3,
    "task.contamination": (36, 16),
}


def runs(name="experiment", worlds=8, steps=60, **overrides):
    """Terms, rewards (steps, W, N ...) and the simulation after random actions."""
    fixed = {"sensing.radius": 0.3, "robot.radius": 0.15, "targets.arrival_rate": 0.0}
    scenario = lissajous_env.scenario(name, **fixed, **overrides)
    simulation = lissajous_env.Simulation(scenario, worlds)
    draw, terms, rewards, actions = np.random.default_rng(0), [], [], []
    for _ in range(steps):
        actions.append(draw.uniform(-1.5, 1.5, simulation.action_shape).astype(np.float32))
        simulation.step(actions[-1])
        terms.append(simulation.reward_terms.numpy().copy())
        rewards.append(simulation.reward.numpy().copy())
    return np.array(terms), np.array(rewards), np.array(actions), simulation


@pytest.mark.parametrize("name", ["experiment", "failure"])
def test_the_reward_is_the_sum_of_its_terms_and_the_return_of_the_rewards(name):
    # Oracle: addition.
    terms, rewards, _, simulation = runs(name, **WEIGHTS)
    assert terms.shape == (60, 8, 5, len(TERMS))
    happens = np.abs(terms).max(axis=(0, 1, 2)) > 0
    assert list(happens) == [name == "experiment" or term != "outside" for term in TERMS], "points stay on the curve"
    np.testing.assert_allclose(rewards, terms.sum(axis=-1), rtol=1e-5, atol=1e-6)
    returns = [row["return_mean"] for row in simulation.score()]
    assert returns == pytest.approx(rewards.astype(float).sum(axis=0).mean(axis=1), abs=1e-3)


def test_the_formulas_that_readers_see_are_what_the_kernel_does():
    # Oracle: each formula, evaluated by Python on the state after a step.
    *_, simulation = runs(steps=7, **WEIGHTS)
    latest, tally, contamination = simulation.latest, simulation.tally, simulation.contamination
    structs = (tally, EpisodeTotals), (contamination, Contamination), (latest, StepEvents)
    state = {name: getattr(struct, name).numpy() for struct, kind in structs for name in kind.vars}
    happened = {name: value.reshape(8, -1) for name, value in state.items()}  # of the team (8, 1), of robots (8, 5)
    weights = dataclasses.asdict(simulation.scenario.task) | {"cells_total": 36 * 16}
    for k, (term, formula) in enumerate(FORMULAS.items()):
        expected = np.broadcast_to(eval(formula, {}, happened | weights), (8, 5))
        np.testing.assert_allclose(latest.terms.numpy()[..., k], expected, rtol=1e-5, atol=1e-7, err_msg=term)
