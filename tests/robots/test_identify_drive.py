"""The constants of differential drives are recovered from logs of their motion."""

import numpy as np
import pytest
from log_messages import EPOCH, KINDS, circles, header, moments, write

import lissajous_env
from lissajous_env.logs.identification import identify
from lissajous_env.logs.inputs import actions_of, inputs_of
from lissajous_env.logs.log import Series, Track
from lissajous_env.logs.reading import read
from lissajous_env.logs.rollouts import MODELS
from lissajous_env.settings.robot import Robot

DRIVE_CONSTANTS = tuple(MODELS["differential"].constants)
DRIVE = Robot(kind="differential")
LIMITS = {"robot.speed_max": 1.2, "robot.yaw_rate_max": 3.0, "robot.speed_min": -0.6}
RATES = {"robot.acceleration_max": 0.8, "robot.yaw_acceleration_max": 5.0}
NOISE = {"noise.position": 0.01, "noise.heading": 0.02, "noise.speed": 0.02, "faults.schedule": ()}


def drive(robot, late=0, seed=1, share=1.0, **fields):
    """Log of a simulated drive under random commands, received `late` steps later, and its true constants."""
    given = {"robot.kind": "differential", **LIMITS, **RATES, **NOISE, **fields}
    made = lissajous_env.scenario("experiment", **given).resolve()
    simulation, random = lissajous_env.Simulation(made, seed=seed), np.random.default_rng(seed)
    wanted = np.repeat(random.uniform(-share, share, (made.task.steps // 8 + 1, 5, 2)), 8, axis=0)
    poses = [simulation.robots.measured.numpy()[0, robot].copy()]
    for k in range(made.task.steps):
        simulation.step(wanted[max(k - late, 0)][None].astype(np.float32))
        poses.append(simulation.robots.measured.numpy()[0, robot].copy())
    time = np.arange(made.task.steps + 1) * made.task.step
    x, y, heading, speed = np.array(poses, dtype=float).T
    track = Track(time, np.stack([x, y, 0 * x], axis=1), np.unwrap(heading), speed)
    motor = simulation.robots.drive.numpy()[0, robot] / made.robot.drive
    wheels = simulation.robots.wheelbase.numpy()[0, robot] / made.robot.wheelbase
    true = [1.0, 1 / wheels, 0.8 * motor, 5.0, late * made.task.step]
    commands = Series(time[:-1], inputs_of(made.robot, wanted[: made.task.steps, robot]))
    return track, commands, dict(zip(DRIVE_CONSTANTS, map(float, true), strict=True))


def test_the_constants_of_a_drive_are_recovered_from_half_a_minute_of_noisy_odometry():
    # Oracle: the constants with which the drive was simulated, those of its own body included.
    track, commands, true = drive(3, late=2, **{"task.duration": 30.0})
    found = identify(track, commands, DRIVE)
    for name in DRIVE_CONSTANTS:
        assert found.values[name] == pytest.approx(true[name], rel=0.02, abs=0.01), name
    assert found.values["delay"] == pytest.approx(0.2, abs=0.01)
    assert found.residual["heading"] == pytest.approx(0.02, rel=0.2)
    assert found.misfits == ()


def test_a_limit_that_no_command_reaches_is_given():
    # Story: with steps of 0.1 m/s and 0.3 rad/s, a tenth of a second is long enough for any acceleration.
    fast = {"robot.acceleration_max": 50.0, "robot.yaw_acceleration_max": 500.0}
    track, commands, _ = drive(1, share=0.1, **fast, **{"task.duration": 20.0})
    found = identify(track, commands, DRIVE)
    assert np.isnan(found.errors["acceleration_max"])
    assert np.isfinite(found.errors["speed_factor"])


def test_other_commands_are_refused():
    track, commands, _ = drive(0, **{"task.duration": 10.0})
    with pytest.raises(ValueError, match=r"commands must be speed \[m/s\] and yaw rate .* got steering, throttle"):
        identify(track, Series(commands.time, commands.value, ("steering", "throttle")), DRIVE)
    with pytest.raises(ValueError, match="log must be of a robot whose speed and yaw rate change"):
        identify(track, Series(commands.time, 0 * commands.value), DRIVE)


def test_twists_are_actions_again():
    robot = lissajous_env.scenario("experiment", **{"robot.kind": "differential", **LIMITS}).resolve().robot
    actions = np.random.default_rng(0).uniform(-1, 1, (100, 2))
    np.testing.assert_allclose(actions_of(robot, inputs_of(robot, actions)), actions, atol=1e-6)
    np.testing.assert_allclose(inputs_of(robot, np.array([[1, 1], [-1, -1]])), [[1.2, 3.0], [-0.6, -3.0]])
    assert actions_of(robot, np.array([9.0, -9.0])).tolist() == [1, -1]


@pytest.mark.parametrize("stamps", [False, True])
def test_twists_of_a_log_are_commands(tmp_path, stamps):
    # Oracle: the numbers that were written; a Twist without a stamp counts from the recorder's time on.
    vector, twist = KINDS["geometry_msgs/msg/Vector3"], KINDS["geometry_msgs/msg/Twist"]
    bag = circles(robots=range(1), times=moments(5.0))
    for t in moments(5.0):
        sent = twist(vector(0.1 * t, 0.0, 0.0), vector(0.0, 0.0, -t))
        message = KINDS["geometry_msgs/msg/TwistStamped"](header(EPOCH + t), sent) if stamps else sent
        bag.append(("/robot_0/cmd_vel", message, EPOCH + t))
    log = read(write(tmp_path / "lab.mcap", bag), commands="/robot_{}/cmd_vel")
    commands = log.commands[0].columns(("yaw rate", "speed"))
    np.testing.assert_allclose(commands, np.stack([-moments(5.0), 0.1 * moments(5.0)], axis=1), atol=1e-9)
