"""The input of a car: actions to steering and throttle and back, by hand and in the simulation."""

import numpy as np
import pytest
import warp as wp

import lissajous_env
from lissajous_env.device.car_input import car_action, steering_and_throttle
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.scenario import Robot

wp.set_module_options(OPTIONS)

ROBOT = Robot(steering_max=0.35, throttle_min=0.1, throttle_max=0.25)


@wp.kernel
def to_input(robot: RobotStruct, given: wp.array(dtype=wp.vec2), out: wp.array(dtype=wp.vec2)):
    out[wp.tid()] = steering_and_throttle(robot, given[wp.tid()])


@wp.kernel
def to_action(robot: RobotStruct, given: wp.array(dtype=wp.vec2), out: wp.array(dtype=wp.vec2)):
    out[wp.tid()] = car_action(robot, given[wp.tid()][0], given[wp.tid()][1])


def mapped(kernel, pairs):
    given = wp.array(np.array(pairs, dtype=np.float32), dtype=wp.vec2, device="cpu")
    out = wp.zeros_like(given)
    wp.launch(kernel, len(pairs), [to_struct(RobotStruct, ROBOT), given, out], device="cpu")
    return out.numpy()


def test_inputs_by_hand():
    # Oracle: full right, straight on at half throttle, full left at full throttle.
    actions = [[-1, -1], [0, 0], [1, 1]]
    inputs = [[-0.35, 0.1], [0, 0.175], [0.35, 0.25]]
    np.testing.assert_allclose(mapped(to_input, actions), inputs, atol=1e-7)
    np.testing.assert_allclose(mapped(to_action, inputs), actions, atol=1e-6)


def test_what_a_car_cannot_do_is_clipped():
    # Oracle: the nearest action of the box.
    assert mapped(to_action, [[0.5, 0.0], [-0.5, 1.0], [0.1, 0.3]]).tolist() == [
        [1, -1],
        [-1, 1],
        [pytest.approx(0.1 / 0.35), 1],
    ]


def test_there_and_back():
    # Oracle: every action of the box comes back; the ends exactly, so that nothing is clipped that was allowed.
    actions = np.random.default_rng(0).uniform(-1, 1, (1000, 2))
    np.testing.assert_allclose(mapped(to_action, mapped(to_input, actions)), actions, atol=2e-6)
    limits = [[0.35, 0.25], [-0.35, 0.1]]
    assert mapped(to_action, limits).tolist() == [[1, 1], [-1, -1]]


def test_the_world_drives_a_car_by_it():
    # Story: a car at the throttle that holds 1 m/s, by (12) without noise, keeps that speed.
    calm = {"noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0, "faults.schedule": (), "task.duration": 10.0}
    scenario = lissajous_env.scenario("experiment", **calm)
    made = scenario.robot
    held = (made.drag * 1.0 + made.offset) / made.drive
    action = 2 * (held - made.throttle_min) / (made.full_throttle - made.throttle_min) - 1
    simulation = lissajous_env.Simulation(scenario)
    for _ in range(100):
        simulation.step(np.full(simulation.action_shape, [0.0, action], dtype=np.float32))
    np.testing.assert_allclose(simulation.robots.speed.numpy(), 1.0, atol=1e-3)
