"""The constants of cars and differential drives are recovered from logs of their motion."""

from dataclasses import replace

import numpy as np
import pytest
from log_messages import EPOCH, KINDS, circles, header, moments, write

import lissajous_env
from lissajous_env.logs.commands import COMMAND_NAMES, commands_of_actions, named_commands
from lissajous_env.logs.identification import MODELS, identify
from lissajous_env.logs.log import Series, Track
from lissajous_env.logs.motion import motion_of
from lissajous_env.logs.reading import read
from lissajous_env.settings.parts import Robot

CONSTANTS = tuple(MODELS["car"])
NOISE = {"noise.position": 0.01, "noise.heading": 0.02, "noise.speed": 0.02, "faults.schedule": ()}


def logs(robots, late=0, seed=1, same=4, share=1.0, scale=(1.0, 1.0), **fields):
    """Log of simulated robots under random commands, the same for some steps, which are received `late` steps later."""
    scenario = lissajous_env.scenario("experiment", **(NOISE | fields)).scaled(*scale).resolve()
    simulation, random = lissajous_env.Simulation(scenario, seed=seed), np.random.default_rng(seed)
    wanted = np.repeat(random.uniform(-share, share, (-(-scenario.task.steps // same), 5, 2)), same, axis=0)
    poses = [simulation.robots.measured.numpy()[0].copy()]
    for k in range(scenario.task.steps):
        simulation.step(wanted[max(k - late, 0)][None].astype(np.float32))
        poses.append(simulation.robots.measured.numpy()[0].copy())
    poses, time = np.array(poses, dtype=float), np.arange(scenario.task.steps + 1) * scenario.task.step
    inputs = commands_of_actions(scenario.robot, wanted[: scenario.task.steps].astype(np.float32))
    for i in robots:
        x, y, heading, speed = poses[:, i].T
        track = Track(time, np.stack([x, y, 0 * x], axis=1), np.unwrap(heading), speed)
        yield track, Series(time[:-1], inputs[:, i]), constants_of(simulation, i) | {"delay": late * scenario.task.step}


def constants_of(simulation, robot):
    """True constants of a robot, those of its own body included."""
    body, wheelbase, drive = simulation.scenario.robot, simulation.robots.wheelbase, simulation.robots.drive
    wheelbase, drive = float(wheelbase.numpy()[0, robot]), float(drive.numpy()[0, robot])
    if body.kind == "car":
        own = {"wheelbase": wheelbase, "drive": drive}
        return own | {name: getattr(body, name) for name in ("drag", "offset", "dead_zone")}
    factors = {"speed_factor": 1.0, "yaw_factor": body.wheelbase / wheelbase}
    limits = {"acceleration_max": body.acceleration_max * drive / body.drive}
    return factors | limits | {"yaw_acceleration_max": body.yaw_acceleration_max}


def check(fit, true, rel, names=CONSTANTS[:4]):
    for name in names:
        assert fit.values[name] == pytest.approx(true[name], rel=rel), name
        assert abs(fit.values[name] - true[name]) < 5 * fit.errors[name] + 1e-4 * true[name], name


@pytest.fixture(scope="module")
def minute():
    """A minute of noisy odometry: the track, the commands, the true constants, and what is identified."""
    ((track, commands, true),) = logs([3])
    return track, commands, true, identify(track, commands, Robot())


def test_the_constants_of_a_car_are_recovered_within_two_percent_from_a_minute_of_noisy_odometry(minute):
    # Oracle: the constants with which the car was simulated, those of its own body included.
    _, _, true, fit = minute
    check(fit, true, 0.02)
    assert fit.values["delay"] < 0.005
    assert fit.residual["position"] == pytest.approx(0.01, rel=0.15)
    assert fit.residual["speed"] == pytest.approx(0.02, rel=0.15)
    assert np.isnan(fit.errors["dead_zone"])  # no throttle lies below it
    assert fit.misfits == ()


def test_the_constants_of_a_car_of_another_size_and_pace_than_the_guess_are_recovered():
    # Oracle: the law of similarity, lengths over 4 and times over 2; times are of the epoch, and places of a map.
    ((track, commands, true),) = logs([3], scale=(0.25, 0.5))
    track = replace(track, time=track.time + EPOCH, position=track.position + np.array([435_000.0, 5.4e6, 0.0]))
    check(identify(track, replace(commands, time=commands.time + EPOCH)), true, 0.02)


@pytest.mark.parametrize("noisy", [False, True])
def test_poses_with_speed_are_enough(noisy):
    # Oracle: the constants with which the car was simulated. Differences of positions are no speeds.
    fields = {} if noisy else dict.fromkeys((name for name in NOISE if name.startswith("noise")), 0.0)
    ((track, commands, true),) = logs([2], **fields, **{"task.duration": 61.0 if noisy else 21.0})
    fit = identify(replace(track, speed=0 * track.speed if noisy else np.nan * track.speed), commands, Robot())
    check(fit, true, 0.02 if noisy else 1e-3)
    assert np.isnan(fit.residual["speed"])
    assert fit.misfits == ()


def test_poses_that_are_most_of_a_second_apart_are_enough():
    # Oracle: the constants with which the car was simulated. The last pose is later than the last command.
    coarse = {"task.step": 0.8, "task.duration": 100.8, "task.substeps": 8}
    ((track, commands, true),) = logs([1], same=1, share=0.4, **coarse)
    check(identify(replace(track, speed=np.nan * track.speed), commands), true, 0.02)


def test_commands_in_another_order_are_matched_by_name_or_named_as_a_misfit():
    ((track, commands, _),) = logs([2], **{"task.duration": 12.0})
    named = Series(commands.time, commands.value[:, ::-1], ("throttle", "steering"))
    np.testing.assert_array_equal(named_commands(named, COMMAND_NAMES["car"]), commands.value)
    swapped = identify(track, Series(commands.time, commands.value[:, ::-1]), Robot())
    assert swapped.misfits == ("position", "heading", "speed")


def test_a_dead_zone_and_a_delay_of_a_car_that_reverses_are_recovered():
    back = {"robot.speed_min": -5.0, "robot.throttle_min": 0.0, "robot.dead_zone": 0.12}
    ((track, commands, true),) = logs([1], late=2, **back)
    assert track.speed.min() < -1.0
    guess = lissajous_env.scenario("experiment", **back | {"robot.dead_zone": 0.0}).resolve().robot
    check(identify(track, commands, guess), true, 0.02, CONSTANTS)


def test_a_bad_first_guess_uneven_times_repeated_poses_and_failures_do_not_matter(minute):
    # Nor do poses after the last command that was recorded.
    track, commands, true, _ = minute
    commands = Series(commands.time[:-60], commands.value[:-60])
    rows = np.repeat(np.sort(np.random.default_rng(0).permutation(len(track))[:450]), 2)
    speed = np.where((track.time >= 20) & (track.time < 30), 0.0, track.speed)
    status = Series(track.time, ((track.time >= 20) & (track.time < 30)).astype(int))
    time = track.time[rows] + np.tile([0.0, 0.03], 450)
    thinned = Track(time, track.position[rows], track.heading[rows] + 4 * np.pi, speed[rows])
    fit = identify(thinned, commands, Robot(wheelbase=0.3, drag=2.0, drive=20.0, offset=2.0), status)
    check(fit, true, 0.03)
    assert fit.values["delay"] < 0.005


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, c: (Track(t.time[:10], t.position[:10], t.heading[:10], t.speed[:10]), c), "at least 20 poses"),
        (lambda t, c: (t, Series(c.time, 0 * c.value)), "whose speed and steering change"),
        (lambda t, c: (t, Series(c.time, c.value, ("steer", "gas"))), r"steering \[rad\] and throttle, got steer, gas"),
        (lambda t, c: (t, Series(c.time, c.value * (57.3, 1))), "is it in degrees"),
        (lambda t, c: (t, Series(c.time, c.value * (np.nan, 1))), "commands must be finite, got array"),
        (lambda t, c: (t, Series(c.time, c.value[:, 0])), "and throttle, got values of shape .* without names"),
    ],
)
def test_a_log_that_shows_nothing_is_refused(change, words):
    ((track, commands, _),) = logs([0], **{"task.duration": 10.0})
    with pytest.raises(ValueError, match=words):
        identify(*change(track, commands))


@pytest.mark.filterwarnings("error")
def test_a_motor_that_no_throttle_drives_is_given():
    ((track, commands, _),) = logs([3], **{"task.duration": 12.0})
    for factors in ((1, -1), (1, 0)):
        errors = identify(track, Series(commands.time, commands.value * factors)).errors
        assert np.isnan([errors[name] for name in ("drive", "offset", "dead_zone")]).all()


@pytest.mark.parametrize(("seed", "noise"), [(1, 0.0), (5, 1.0)])
def test_logged_speeds_count_exactly_if_they_lead_from_pose_to_pose(seed, noise):
    # Law: however fast a car turns between two poses, its speeds are used; no others are.
    noises = {"noise.position": 0.01 * noise, "noise.heading": 0.02 * noise, "noise.speed": 0.0}
    for track, *_ in logs([0, 1], seed=seed, same=1, **noises, **{"task.duration": 20.0}):
        assert motion_of(track).why_derived == ""
        still = np.random.default_rng(seed).normal(0, 0.01 * noise, track.position.shape)
        assert motion_of(Track(track.time, still, track.heading, 0 * track.speed)).why_derived == ""
        for wrong in (0 * track.speed, 3 * track.speed, -track.speed):
            assert motion_of(replace(track, speed=wrong)).why_derived == "do not match the poses"


LIMITS = {"robot.kind": "differential", "robot.speed_max": 1.2, "robot.yaw_rate_max": 3.0, "robot.speed_min": -0.6}


@pytest.mark.parametrize(("late", "limits"), [(2, (0.8, 5.0)), (0, (4.0, 20.0))])
def test_the_constants_of_a_drive_are_recovered_from_half_a_minute_of_noisy_odometry(late, limits):
    # Oracle: the constants with which the drive was simulated, those of its own body included; others are given.
    fields = dict(zip(("robot.acceleration_max", "robot.yaw_acceleration_max"), limits, strict=True)) | LIMITS
    ((track, commands, true),) = logs([3], seed=3, late=late, same=8, **fields, **{"task.duration": 30.0})
    fit = identify(track, commands, Robot(kind="differential", acceleration_max=0.1, yaw_acceleration_max=0.5))
    for name in MODELS["differential"]:
        assert fit.values[name] == pytest.approx(true[name], rel=0.02, abs=0.01), name
    assert fit.residual["heading"] == pytest.approx(0.02, rel=0.2)
    assert fit.misfits == ()


def test_a_limit_that_no_command_reaches_is_given():
    # Story: with steps of 0.1 m/s and 0.3 rad/s, a tenth of a second is long enough for any acceleration.
    fast = LIMITS | {"robot.acceleration_max": 50.0, "robot.yaw_acceleration_max": 500.0}
    ((track, commands, _),) = logs([1], same=8, share=0.1, **fast, **{"task.duration": 20.0})
    fit = identify(track, commands, Robot(kind="differential"))
    assert np.isnan(fit.errors["acceleration_max"])
    assert np.isfinite(fit.errors["speed_factor"])


@pytest.mark.parametrize("stamps", [False, True])
def test_twists_of_a_log_are_commands(tmp_path, stamps):
    # Oracle: the numbers that were written; a Twist without a stamp counts from the recorder's time on.
    vector, twist = KINDS["geometry_msgs/msg/Vector3"], KINDS["geometry_msgs/msg/Twist"]
    bag = circles(robots=range(1), times=moments(5.0)[5:-5])
    for t in moments(5.0):
        sent = twist(vector(0.1 * t, 0.0, 0.0), vector(0.0, 0.0, -t))
        message = KINDS["geometry_msgs/msg/TwistStamped"](header(EPOCH + t), sent) if stamps else sent
        bag.append(("/robot_0/cmd_vel", message, EPOCH + t))
    log = read(write(tmp_path / "lab.mcap", bag), commands="/robot_{}/cmd_vel")
    np.testing.assert_allclose(log.commands[0].time - EPOCH, moments(5.0), atol=1e-6)
    commands = named_commands(log.commands[0], ("yaw rate", "speed"))
    np.testing.assert_allclose(commands, np.stack([-moments(5.0), 0.1 * moments(5.0)], axis=1), atol=1e-9)
