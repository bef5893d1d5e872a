"""Cars: their input by hand, and their motion compared with closed forms of (12), forwards and in reverse."""

import math

import numpy as np
import pytest
import reference
import reference_driving
import warp as wp
from one_robot import ALONE, driven, one_robot

import baselines
import lissajous_env
from baselines.policies.base import Filtered, Policy
from baselines.policies.safety.safe import Safe
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.logs.commands import actions_of_commands, commands_of_actions
from lissajous_env.parameters.scenario import Robot
from lissajous_env.theory import closed_forms
from lissajous_env.world.observation import layout
from lissajous_env.world.robots.car import car_action
from training.learned.card import Card

wp.set_module_options(OPTIONS)

BACK = {"robot.speed_max": 1.5, "robot.speed_min": -1.5, "robot.dead_zone": 0.11, "robot.lateral_acceleration_max": 3.0}


def throttle_action(robot, throttle):
    return 2 * (throttle - robot.throttle_min) / (robot.throttle_max - robot.throttle_min) - 1


# The input of a car.


@wp.kernel
def to_action(robot: RobotStruct, commands: wp.array(dtype=wp.vec2), out: wp.array(dtype=wp.vec2)):
    out[wp.tid()] = car_action(robot, commands[wp.tid()][0], commands[wp.tid()][1])


def test_inputs_by_hand_and_there_and_back():
    # Oracle: full right, straight on at half throttle, full left at full throttle; what a car cannot do is clipped.
    robot = Robot(steering_max=0.35, throttle_min=0.1, throttle_max=0.25)
    actions, inputs = [[-1, -1], [0, 0], [1, 1]], [[-0.35, 0.1], [0, 0.175], [0.35, 0.25]]
    np.testing.assert_allclose(commands_of_actions(robot, np.float32(actions)), inputs, atol=1e-7)
    commands = wp.array(np.float32([*inputs, [0.5, 0.0], [-0.5, 1.0]]), dtype=wp.vec2, device="cpu")
    out = wp.zeros_like(commands)
    wp.launch(to_action, 5, [to_struct(RobotStruct, robot), commands, out], device="cpu")
    np.testing.assert_allclose(out.numpy(), [*actions, [1, -1], [-1, 1]], atol=1e-6)


def test_the_throttle_of_cars_that_reverse_by_hand():
    # Oracle: drive 36.81, offset 3.681, drag 0.945: 1.5 m/s requires (0.945 1.5 + 3.681) / 36.81 in either direction.
    robot = lissajous_env.scenario("experiment", **{"robot.speed_max": 1.5, "robot.speed_min": -1.5}).resolve().robot
    full = (0.945 * 1.5 + 3.681) / 36.81
    actions = np.float32([[0, -1], [0, -0.5], [0, 0], [0, 0.5], [0, 1]])
    throttles = [-full, -(0.1 + full) / 2, 0.1, (0.1 + full) / 2, full]
    np.testing.assert_allclose(commands_of_actions(robot, actions)[:, 1], throttles, atol=1e-7)
    some = np.random.default_rng(0).uniform(-1, 1, (1000, 2)).astype(np.float32)
    np.testing.assert_allclose(actions_of_commands(robot, commands_of_actions(robot, some)), some, atol=2e-5)
    ends = np.float32([[0, 0.05], [0, -0.05], [0, 1], [0, -1]])
    assert actions_of_commands(robot, ends)[:, 1].tolist() == [0, 0, 1, -1]


# Closed forms.


@pytest.mark.parametrize("steering", [1.0, -0.5])
def test_a_car_drives_a_circle_of_radius_wheelbase_over_tan_steering(steering):
    # Oracle: closed form l / tan(delta). The centre lies a radius to the left of the car; sub-steps cost 1e-4 of that.
    simulation = one_robot(**{"robot.wheelbase": 0.3})
    robot = simulation.scenario.robot
    x, y, heading = driven(simulation, [[steering, throttle_action(robot, 0.12)]] * 200)[100:, :3].T
    radius = robot.wheelbase / math.tan(steering * robot.steering_max)
    centre = np.stack([x - radius * np.sin(heading), y + radius * np.cos(heading)])
    assert np.abs(centre - centre.mean(axis=1, keepdims=True)).max() < 3e-4 * abs(radius)
    assert np.ptp(x) > abs(radius)


def test_a_car_coasts_in_the_dead_zone():
    # Oracle: closed form v0 exp(-c t) up to the edge of the dead zone; just above it the motor drives. In reverse, it
    # also coasts between the dead zone and the throttle at which the motor overcomes its offset.
    coasted = np.exp(-0.945 * 0.1 * np.arange(1, 51))
    simulation = one_robot(speed=1.0, **{"robot.dead_zone": 0.12, "robot.offset": 3.0})
    robot = simulation.scenario.robot
    speeds = driven(simulation, [[0.0, throttle_action(robot, 0.119)]] * 50)[:, 3]
    np.testing.assert_allclose(speeds, coasted, rtol=1e-4)
    assert driven(simulation, [[0.0, throttle_action(robot, 0.121)]] * 10)[-1, 3] > 0.5
    weak = BACK | {"robot.dead_zone": 0.05, "robot.throttle_min": 0.05}
    for direction in (-1.0, 1.0):
        speeds = driven(one_robot(speed=direction, **weak), [[0.0, 0.1 * direction]] * 50)[:, 3]
        np.testing.assert_allclose(direction * speeds, coasted, rtol=1e-4)


def test_full_reverse_reaches_its_speed_and_a_car_brakes_before_it_reverses():
    # Oracle: closed form v = v1 + (v0 - v1) exp(-c t).
    simulation = one_robot(speed=1.0, **BACK | {"robot.speed_min": -0.6})
    states = driven(simulation, [[0.0, -1.0]] * 90)
    np.testing.assert_allclose(states[:, 3], -0.6 + 1.6 * np.exp(-0.945 * 0.1 * np.arange(1, 91)), atol=1e-5)
    speed = simulation.observation.numpy()[0, 0, layout(simulation.scenario).names.index("speed")]
    assert speed == pytest.approx(-0.4, abs=0.01)


@pytest.mark.parametrize("boundary", ["open", "wall"])
def test_backwards_is_the_mirror_image_of_forwards(boundary):
    # Law: (12) of a car that drives backwards is that of one with the opposite heading that steers to the other side.
    actions = np.repeat(np.random.default_rng(5).uniform(-1, 1, (20, 2)), 6, axis=0)
    box = BACK | {"task.boundary": boundary, "robot.steering_max": 0.6}
    ahead = driven(one_robot(1.4, -0.2, 0.3, 1.2, **box), actions)
    back = driven(one_robot(1.4, -0.2, 0.3 + math.pi, -1.2, **box), -actions)
    assert ahead[:, 3].max() > 0.5
    assert ahead[:, 3].min() < -0.5
    assert (np.abs(ahead[:, 0]) == np.float32(1.675)).any() == (boundary == "wall")
    np.testing.assert_allclose(back[:, :2], ahead[:, :2], atol=1e-4)
    np.testing.assert_allclose(back[:, 3], -ahead[:, 3], atol=1e-4)
    np.testing.assert_allclose(np.exp(1j * back[:, 2]), -np.exp(1j * ahead[:, 2]), atol=1e-4)


def test_uneven_cars_differ_by_their_spread_and_reach_their_own_top_speeds():
    # Oracle: mean and deviation of a normal distribution, clipped at three deviations; and the equilibrium of the motor
    # by hand, (36.81 f tau - 3.681) / 0.945 at full throttle, f per robot.
    overrides = {"noise.wheelbase_spread": 0.05, "noise.drive_spread": 0.02}
    robots = lissajous_env.Simulation(lissajous_env.scenario("experiment", **overrides), 2000).robots
    for drawn, middle, spread in [(robots.wheelbase, 0.175, 0.05), (robots.drive, 36.81, 0.02)]:
        relative = drawn.numpy() / middle - 1
        assert abs(relative.mean()) < 4 * spread / math.sqrt(relative.size)
        assert relative.std() == pytest.approx(spread, rel=0.03)
        assert np.abs(relative).max() <= 3.001 * spread
    even = {"noise.drive_spread": 0.0, "task.duration": 30.0}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("evaders-uneven", **even))
    for _ in range(200):
        simulation.step(np.broadcast_to(np.float32([0.0, 1.0]), simulation.action_shape))
    wanted = (36.81 * np.array([0.7824, 0.855, 1.0, 1.0725, 1.145]) * 0.177017 - 3.681) / 0.945
    np.testing.assert_allclose(simulation.robots.speed.numpy()[0], wanted, rtol=1e-4)
    uneven = lissajous_env.scenario("experiment", **{"robot.drive_factors": ((1, 0.5), (1, 3.0), (2, 0.1))})
    assert (uneven.drive_factors.tolist(), uneven.top_speeds[2]) == ([1.0, 1.5, 0.1, 1.0, 1.0], 0.0)  # a weak motor
    with pytest.raises(ValueError, match=r"drive_factors must keep every car's top speed, .* 10000 m/s, got 7308"):
        lissajous_env.scenario("evaders", **{"robot.drive_factors": ((0, 10.0),) * 4})


def test_the_phase_of_a_car_is_that_of_the_nearest_point_of_its_branch():
    # Oracle: a dense search for the nearest point within 0.3 rad, at each of 400 steps near curve (16). The phase gets
    # one correction in a step, so it lags by millimetres; in the tight turns, where the nearest point leaps ahead, by
    # centimetres for a few steps.
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", **ALONE))
    world = reference.world_like(simulation)
    curve, around = simulation.scenario.curve, np.linspace(-0.3, 0.3, 6001)
    excess, phases = [], []
    for action in reference_driving.smooth_actions((1, 2), 400, seed=1):
        action = (reference_driving.pursuit(world) + 0.2 * action).astype(np.float32)
        simulation.step(action[None])
        world.step(action)
        place = simulation.robots.position.numpy()[0, 0, :2]
        phases.append(float(simulation.robots.phase.numpy()[0, 0]))
        distance = np.linalg.norm(closed_forms.curve_point(curve, phases[-1] + around) - place, axis=1)
        excess.append(np.linalg.norm(closed_forms.curve_point(curve, phases[-1]) - place) - distance.min())
    assert np.percentile(excess, 80) < 5e-3
    assert np.percentile(excess, 95) < 0.03
    assert max(excess) < 0.2
    # No jump to another branch, of which there are seven to cross in a lap.
    steps = np.diff(np.unwrap(phases))
    assert steps.max() < 0.101  # the limit of a correction
    assert steps.min() > -0.05
    assert steps.sum() > 2 * math.pi


# Policies of cars that could reverse.


@pytest.mark.parametrize("policy", ["kuramoto-mpcc", "partition", "still"])
def test_policies_drive_cars_that_could_reverse_as_those_that_cannot(policy):
    # Law: nobody reverses, so the cars move in the same way up to the rounding of actions.
    states = []
    for speed_min in (0.0, -1.0):
        scenario = lissajous_env.scenario("evaders", **{"robot.speed_min": speed_min, "noise.drive_spread": 0.0})
        simulation, driver = lissajous_env.Simulation(scenario, 2, seed=1), baselines.make(policy, scenario, 2)
        for _ in range(40):
            simulation.step(driver.act(simulation.observation))
        states.append((simulation.robots.position.numpy(), simulation.robots.speed.numpy()))
    for one, other in zip(*states, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-3)


class Backwards(Policy):
    """Robot 0 backs up at full throttle; robot 1 stands."""

    kind, arrays = "car", "warp"

    def decide(self, observation):
        action = np.zeros(self.action.shape, dtype=np.float32)
        action[:, 0, 1] = -1.0
        return wp.array(action, dtype=wp.float32, device=self.device)


def test_the_filter_stops_a_car_that_would_back_into_another():
    # Story: without the filter, the car backs into the one behind it.
    two = {"robot.count": 2, "formation.ring": None, "sensing.radius": 1.2, "robot.speed_min": -0.8}
    scenario, gaps = lissajous_env.scenario("experiment", **{"faults.schedule": ()}, **two), {}
    for wrap in (False, True):
        policy = Filtered(Backwards(scenario), Safe) if wrap else Backwards(scenario)
        simulation = lissajous_env.Simulation(scenario)
        simulation.robots.position.assign(np.float32([[[0.0, 0.0, 0.0], [-0.9, 0.02, 0.0]]]))
        simulation.robots.heading.zero_()
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
    with pytest.raises(ValueError, match=r"robot.speed_min must be 0 for the policy trained on evaders \[m/s\], got"):
        card.check(scenario)
