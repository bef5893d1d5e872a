"""Messages as policies send and read them: classical, filtered, learned and random ones."""

import dataclasses

import numpy as np
import pytest
import warp as wp
from test_messages import draws, heard, speaking
from test_network import make_team

import baselines
import lissajous_env
from baselines.policies.base import Filtered
from baselines.policies.registry import make
from baselines.policies.safety.safe import Safe, SafetyParameters
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.world.robots.point import POINT
from training.learned.card import Card
from training.learned.policy import LearnedTeam

wp.set_module_options(OPTIONS)


CLASSICAL = {
    "failure": ("kuramoto", "random", "still"),
    "rough": ("kuramoto-mpcc", "consensus-gvf", "sweep", "laps", "random", "partition", "sweep-safe", "sweep-proved"),
}
"""Policies of each kernel that writes an action."""


@pytest.mark.parametrize("name", ["failure", "rough"])
def test_classical_policies_send_zeros_and_move_as_ever(name):
    # Oracle: the same policy without messages, bit for bit.
    plain, talking = speaking(name, 0), speaking(name, 2)
    for policy in CLASSICAL[name]:
        both = [make(policy, plain, 2), make(policy, talking, 2)]
        simulations = [lissajous_env.Simulation(scenario, 2, seed=6) for scenario in (plain, talking)]
        for _ in range(4):
            first, second = (p.act(s.observation.numpy()) for p, s in zip(both, simulations, strict=True))
            assert second[..., : first.shape[-1]].tobytes() == first.tobytes(), policy
            assert not second[..., first.shape[-1] :].any(), policy
            for simulation, action in zip(simulations, (first, second), strict=True):
                simulation.step(action)


def test_a_network_without_messages_sends_zeros():
    # Oracle: the network without messages.
    plain, talking, cars = speaking(k=0), speaking(k=32), speaking("experiment", 0)
    card, network = Card.of(plain), make_team(1)
    rows = lissajous_env.Simulation(talking, 3, seed=1).observation.numpy()
    action = LearnedTeam(network, card, talking, 3).act(rows)
    alone = LearnedTeam(network, card, plain, 3).act(lissajous_env.Simulation(plain, 3, seed=1).observation.numpy())
    np.testing.assert_array_equal(action[..., :1], alone)
    assert not action[..., 1:].any()
    assert baselines.Onboard(LearnedTeam(make_team(2), Card.of(cars), cars), cars, 0).listens


class Talker(baselines.Policy):
    """Cars at full throttle, straight on, that send their own x and y."""

    def decide(self, observation):
        action = np.zeros(self.action.shape, dtype=np.float32)
        action[..., 1] = 1
        action[..., 2:] = 0.2 * observation[..., :2]
        return action


def test_the_filter_passes_messages_on():
    # Oracle: what the policy sends; steering and throttle are changed, so that the filter has something to do.
    scenario = speaking("intruders", 2, **{"formation.start": "random"})
    simulation, wide = lissajous_env.Simulation(scenario, 4, seed=2), SafetyParameters(clearance=0.07, growth=0.2)
    safe, bare, changed = Filtered(Talker(scenario, 4), Safe, wide), Talker(scenario, 4), 0
    for _ in range(15):
        rows = simulation.observation.numpy()
        wanted, action = bare.act(rows), safe.act(rows)
        np.testing.assert_array_equal(action[..., 2:], wanted[..., 2:])
        changed += (action[..., :2] != wanted[..., :2]).sum()
        simulation.step(action)
    assert changed > 0


def test_random_robots_of_a_model_of_ones_own_send_at_random():
    # Oracle: the spread of uniform numbers; the model is not one that the policy knows.
    lissajous_env.register_robot_model(dataclasses.replace(POINT, name="bead"))
    scenario = speaking(k=2, **{"robot.kind": "bead"})
    policy, simulation = baselines.make("random", scenario, 50), lissajous_env.Simulation(scenario, 50)
    simulation.step(np.random.default_rng(0).uniform(-1, 1, simulation.action_shape))
    drawn, again = (policy.act(simulation.observation.numpy()) for _ in range(2))
    assert drawn[..., 1:].std() == pytest.approx(3**-0.5, abs=0.05)
    assert (drawn != again).all(), "also of robots that do not move"


@pytest.mark.parametrize("k", [0, 1, 3])
def test_readers_of_rows_find_messages(k):
    # Oracle: the entries by their names.
    simulation = lissajous_env.Simulation(speaking("experiment", k, **{"sensing.robots_seen": 3}), 2)
    for action in draws(simulation, 3):
        simulation.step(action)
    expected = heard(simulation) if k else np.zeros((2, 5, 2, 0))
    rows = baselines.Rows(simulation.observation.numpy(), simulation.scenario)
    np.testing.assert_array_equal(rows.message, expected)
    message = r"observation must have rows of \d+ numbers for experiment, got shape \(2, 5, 1\)"
    with pytest.raises(ValueError, match=message):
        baselines.Rows(rows.values[..., :1], simulation.scenario)
