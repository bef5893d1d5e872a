"""Cars that reverse: the throttle of an action, the mirror image of driving forwards, and who drives such cars."""

import math

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
from baselines.policies.base import Policy
from baselines.policies.safety.filter import Safe
from baselines.policies.safety.filtered import Filtered
from lissajous_env.logs.car_input import actions_of, inputs_of
from lissajous_env.world.observation import layout
from training.learned.card import Card

EVEN = {"noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0, "faults.schedule": (), "task.duration": 20.0}
ONE = {"robot.count": 1, "formation.p": 0, "formation.ring": None}
BACK = {"robot.speed_max": 1.5, "robot.speed_min": -1.5, "robot.dead_zone": 0.11, "robot.lateral_acceleration_max": 3.0}


def one_car(x, y, heading, speed, **overrides):
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", **{**EVEN, **ONE, **BACK, **overrides}))
    simulation.robots.position.assign(np.float32([[[x, y, 0.0]]]))
    simulation.robots.heading.assign(np.float32([[heading]]))
    simulation.robots.speed.assign(np.float32([[speed]]))
    return simulation


def driven(simulation, actions):
    """(K, 4) x, y, heading and speed of the one car after each action."""
    states = []
    for action in actions:
        simulation.step(np.float32(action)[None, None])
        robots = simulation.robots
        states.append([*robots.position.numpy()[0, 0, :2], robots.heading.numpy()[0, 0], robots.speed.numpy()[0, 0]])
    return np.array(states, dtype=float)


def test_the_throttle_of_an_action_by_hand():
    # Oracle: drive 36.81, offset 3.681, drag 0.945: 1.5 m/s requires (0.945 1.5 + 3.681) / 36.81 in either direction.
    robot = lissajous_env.scenario("experiment", **{"robot.speed_max": 1.5, "robot.speed_min": -1.5}).resolve().robot
    full = (0.945 * 1.5 + 3.681) / 36.81
    actions = np.float32([[0, -1], [0, -0.5], [0, 0], [0, 0.5], [0, 1]])
    throttles = [-full, -(0.1 + full) / 2, 0.1, (0.1 + full) / 2, full]
    np.testing.assert_allclose(inputs_of(robot, actions)[:, 1], throttles, atol=1e-7)
    some = np.random.default_rng(0).uniform(-1, 1, (1000, 2)).astype(np.float32)
    np.testing.assert_allclose(actions_of(robot, inputs_of(robot, some)), some, atol=2e-5)
    assert actions_of(robot, np.float32([[0, 0.05], [0, -0.05], [0, 1], [0, -1]]))[:, 1].tolist() == [0, 0, 1, -1]


@pytest.mark.parametrize("boundary", ["open", "wall"])
def test_backwards_is_the_mirror_image_of_forwards(boundary):
    # Law: (12) of a car that drives backwards is that of one with the opposite heading that steers to the other side.
    draw = np.random.default_rng(5)
    actions = np.repeat(draw.uniform(-1, 1, (20, 2)), 6, axis=0)
    box = {"task.boundary": boundary, "robot.steering_max": 0.6}
    ahead = driven(one_car(1.4, -0.2, 0.3, 1.2, **box), actions)
    back = driven(one_car(1.4, -0.2, 0.3 + math.pi, -1.2, **box), -actions)
    assert ahead[:, 3].max() > 0.5
    assert ahead[:, 3].min() < -0.5
    assert (np.abs(ahead[:, 0]) == np.float32(1.675)).any() == (boundary == "wall")
    np.testing.assert_allclose(back[:, :2], ahead[:, :2], atol=1e-4)
    np.testing.assert_allclose(back[:, 3], -ahead[:, 3], atol=1e-4)
    np.testing.assert_allclose(np.exp(1j * back[:, 2]), -np.exp(1j * ahead[:, 2]), atol=1e-4)


def test_full_reverse_reaches_its_speed_and_a_car_brakes_before_it_reverses():
    # Oracle: closed form v = v1 + (v0 - v1) exp(-c t).
    states = driven(one_car(0.0, 0.0, 0.0, 1.0, **{"robot.speed_min": -0.6}), [[0.0, -1.0]] * 90)
    times = 0.1 * np.arange(1, 91)
    np.testing.assert_allclose(states[:, 3], -0.6 + 1.6 * np.exp(-0.945 * times), atol=1e-5)


def test_a_weak_throttle_does_not_push_a_car_the_other_way():
    # Story: between the dead zone and the throttle at which the motor overcomes its offset, the car coasts.
    weak = {"robot.dead_zone": 0.05, "robot.throttle_min": 0.05}
    for direction in (-1.0, 1.0):
        speeds = direction * driven(one_car(0.0, 0.0, 0.0, direction, **weak), [[0.0, 0.1 * direction]] * 60)[:, 3]
        np.testing.assert_allclose(speeds, np.exp(-0.945 * 0.1 * np.arange(1, 61)), rtol=1e-4)


@pytest.mark.parametrize("policy", ["kuramoto-mpcc", "kuramoto-gvf", "partition", "sweep", "still"])
def test_policies_drive_cars_that_could_reverse_as_those_that_cannot(policy):
    # Law: nobody reverses, so the cars move in the same way up to the rounding of actions.
    states = []
    for speed_min in (0.0, -1.0):
        scenario = lissajous_env.scenario("evaders", **EVEN, **{"robot.speed_min": speed_min})
        simulation, made = lissajous_env.Simulation(scenario, 2, seed=1), baselines.make(policy, scenario, 2)
        for _ in range(60):
            simulation.step(made.act(simulation.observation))
        states.append((simulation.robots.position.numpy(), simulation.robots.speed.numpy()))
    for one, other in zip(*states, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-3)


def test_a_robot_observes_that_it_reverses():
    simulation = one_car(0.0, 0.0, 0.0, -0.75)
    driven(simulation, [[0.0, -1.0]] * 40)
    names = list(layout(simulation.scenario).names)
    assert simulation.observation.numpy()[0, 0, names.index("speed")] == pytest.approx(-1.0, abs=0.05)


class Backwards(Policy):
    """Robot 0 backs up at full throttle; robot 1 stands."""

    kind = "car"

    def decide(self, observation):
        action = np.zeros(self.action.shape, dtype=np.float32)
        action[:, 0, 1] = -1.0
        return wp.array(action, dtype=wp.float32, device=self.device)

    arrays = "warp"


def test_the_filter_stops_a_car_that_would_back_into_another():
    # Story: without the filter, the car backs into the one behind it.
    two = {"robot.count": 2, "formation.ring": None, "sensing.radius": 1.2, "robot.speed_min": -0.8}
    scenario = lissajous_env.scenario("experiment", **EVEN, **two)
    gaps = {}
    for wrap in (False, True):
        policy = Filtered(Backwards(scenario), Safe) if wrap else Backwards(scenario)
        simulation = lissajous_env.Simulation(scenario)
        simulation.robots.position.assign(np.float32([[[0.0, 0.0, 0.0], [-0.9, 0.02, 0.0]]]))
        simulation.robots.heading.assign(np.float32([[0.0, 0.0]]))
        simulation.robots.speed.zero_()
        simulation.step(np.zeros((1, 2, 2), dtype=np.float32))
        for _ in range(60):
            simulation.step(policy.act(simulation.observation))
        gaps[wrap] = simulation.score()[0]["min_separation"]
    assert gaps[False] < 0.2
    assert gaps[True] > 2 * scenario.robot.radius


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"robot.speed_min": 0.5}, r"robot.speed_min must be from -10000 to 0 \[m/s\], got 0.5"),
        ({"robot.speed_min": -1.0, "robot.throttle_min": 0.12}, r"robot.throttle_min must be at most dead_zone, 0.1"),
        ({"robot.speed_min": -0.5, "robot.offset": 0.0}, r"robot.speed_min must be reached at a throttle above dead"),
    ],
)
def test_a_car_that_cannot_reverse_so_is_refused_by_name(overrides, words):
    with pytest.raises(ValueError, match=words):
        lissajous_env.scenario("experiment", **overrides)


def test_who_cannot_drive_cars_that_reverse_refuses_them_by_name():
    scenario = lissajous_env.scenario("evaders", **{"robot.speed_min": -1.0})
    with pytest.raises(ValueError, match=r"robot.speed_min must be 0 for cars behind -proved, .* got -1"):
        baselines.make("partition-proved", scenario)
    card = Card.of(lissajous_env.scenario("evaders"))
    with pytest.raises(
        ValueError, match=r"robot.speed_min must be 0 for the policy trained on evaders \[m/s\], got -1"
    ):
        card.columns(scenario)
    assert len(Card.of(scenario).columns(scenario)) == len(card.inputs)
