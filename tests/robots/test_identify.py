"""The constants of cars are recovered from logs of their motion."""

import numpy as np
import pytest

import lissajous_env
from lissajous_env.logs.identification import identify
from lissajous_env.logs.inputs import actions_of, inputs_of
from lissajous_env.logs.log import Series, Track
from lissajous_env.logs.motion import motion_of
from lissajous_env.logs.rollouts import MODELS, Rollouts
from lissajous_env.settings.robot import Robot

CONSTANTS = tuple(MODELS["car"].constants)
NOISE = {"noise.position": 0.01, "noise.heading": 0.02, "noise.speed": 0.02, "faults.schedule": ()}


def drive(robots, late=0, seed=1, faster=False, **fields):
    """Log of simulated cars under random commands, which the cars receive `late` steps later, with true constants."""
    made = lissajous_env.scenario("experiment", **(NOISE | fields)).resolve()
    simulation, random = lissajous_env.Simulation(made, seed=seed), np.random.default_rng(seed)
    same = 1 if faster else 4  # steps in which the commands are the same
    wanted = np.repeat(random.uniform(-1, 1, (made.task.steps // same, 5, 2)), same, axis=0).astype(np.float32)
    poses = [simulation.robots.measured.numpy()[0].copy()]
    for k in range(made.task.steps):
        simulation.step(wanted[max(k - late, 0)][None])
        poses.append(simulation.robots.measured.numpy()[0].copy())
    poses, time = np.array(poses, dtype=float), np.arange(made.task.steps + 1) * made.task.step
    given, logs = inputs_of(made.robot, wanted), []
    for i in robots:
        x, y, heading, speed = poses[:, i].T
        track = Track(time, np.stack([x, y, 0 * x], axis=1), np.unwrap(heading), speed)
        own = [simulation.robots.wheelbase.numpy()[0, i], made.robot.drag, simulation.robots.drive.numpy()[0, i]]
        true = [*own, made.robot.offset, made.robot.dead_zone, late * made.task.step]
        logs.append((track, Series(time[:-1], given[:, i]), dict(zip(CONSTANTS, map(float, true), strict=True))))
    return logs


def standing(track):
    return Track(track.time, 0 * track.position, 0 * track.heading, 0 * track.speed)


def without_speeds(track, speed):
    """The same log without measured speeds: NaN, never filled, or marked as no measurements."""
    return Track(track.time, track.position, track.heading, speed, measured=False)


def test_the_constants_of_a_car_are_recovered_within_two_percent_from_a_minute_of_noisy_odometry():
    # Oracle: the constants with which the car was simulated, those of its own body included.
    for track, commands, true in drive([0, 3]):
        found = identify(track, commands, Robot())
        for name in ("wheelbase", "drag", "drive", "offset"):
            assert found.values[name] == pytest.approx(true[name], rel=0.02), name
            assert abs(found.values[name] - true[name]) < 5 * found.errors[name], name
        assert found.values["delay"] < 0.005
        assert found.residual["position"] == pytest.approx(0.01, rel=0.15)
        assert found.residual["speed"] == pytest.approx(0.02, rel=0.15)
        assert np.isnan(found.errors["dead_zone"])  # no throttle lies below it


@pytest.mark.parametrize("noisy", [False, True])
def test_poses_without_speeds_are_enough(noisy):
    # Oracle: the constants with which the car was simulated. Differences of positions are no speeds.
    fields = {} if noisy else dict.fromkeys((name for name in NOISE if name.startswith("noise")), 0.0)
    ((track, commands, true),) = drive([2], **fields)
    for speed in (np.nan * track.speed, 0 * track.speed) if noisy else (np.nan * track.speed,):
        found = identify(without_speeds(track, speed), commands, Robot())
        for name in ("wheelbase", "drag", "drive", "offset"):
            assert found.values[name] == pytest.approx(true[name], rel=0.02 if noisy else 1e-3), name
            assert abs(found.values[name] - true[name]) < 5 * found.errors[name] + 1e-4 * true[name], name
        assert np.isnan(found.residual["speed"])
        assert found.misfits == ()


def test_commands_in_another_order_are_matched_by_name_or_named_as_a_misfit():
    ((track, commands, true),) = drive([2])
    named = Series(commands.time, commands.value[:, ::-1], ("throttle", "steering"))
    found = identify(track, named, Robot())
    assert found.values["drive"] == pytest.approx(true["drive"], rel=0.02)
    assert found.misfits == ()
    swapped = identify(track, Series(commands.time, commands.value[:, ::-1]), Robot())
    assert swapped.misfits == ("position", "heading", "speed")


def test_a_dead_zone_and_a_delay_are_recovered():
    zone = {"robot.throttle_min": 0.0, "robot.dead_zone": 0.12}
    ((track, commands, true),) = drive([1], late=2, **zone)
    found = identify(track, commands, Robot())
    for name in CONSTANTS:
        assert found.values[name] == pytest.approx(true[name], rel=0.02), name


def test_the_constants_of_a_car_that_reverses_are_recovered():
    back = {"robot.speed_min": -5.0, "robot.throttle_min": 0.0, "robot.dead_zone": 0.12}
    ((track, commands, true),) = drive([1], **back)
    assert track.speed.min() < -1.0
    guess = lissajous_env.scenario("experiment", **back).resolve().robot
    found = identify(track, commands, guess)
    for name in CONSTANTS[:-1]:
        assert found.values[name] == pytest.approx(true[name], rel=0.02), name
    assert identify(track, commands, Robot()).misfits, "of a car that does not reverse"


def test_a_bad_first_guess_and_uneven_times_do_not_matter():
    ((track, commands, true),) = drive([2])
    kept = np.sort(np.random.default_rng(0).permutation(len(track))[:450])
    thinned = Track(track.time[kept], track.position[kept], track.heading[kept] + 4 * np.pi, track.speed[kept])
    found = identify(thinned, commands, Robot(wheelbase=0.3, drag=2.0, drive=20.0, offset=2.0))
    for name in ("wheelbase", "drag", "drive", "offset"):
        assert found.values[name] == pytest.approx(true[name], rel=0.02), name


def test_times_in_which_a_car_has_failed_are_left_out():
    ((track, commands, true),) = drive([2])
    broken = track.speed.copy()
    broken[200:300] = 0.0
    status = Series(track.time, np.where((np.arange(len(track)) >= 200) & (np.arange(len(track)) < 300), 1, 0))
    found = identify(Track(track.time, track.position, track.heading, broken), commands, Robot(), status)
    assert found.values["drive"] == pytest.approx(true["drive"], rel=0.02)


def test_more_data_leaves_smaller_errors():
    # A law of statistics: four times the data halves the standard errors, about.
    ((track, commands, _),) = drive([0])
    quarter = Track(track.time[:151], track.position[:151], track.heading[:151], track.speed[:151])
    little, much = identify(quarter, commands), identify(track, commands)
    for name in ("wheelbase", "drive"):
        assert 1.3 < little.errors[name] / much.errors[name] < 4


def test_rollouts_are_the_motion_of_the_simulation():
    # Oracle: a simulated car without noise, whose steps are as long as these.
    quiet = {name: 0.0 for name in NOISE if name.startswith("noise")}
    made = lissajous_env.scenario("experiment", **{"faults.schedule": (), "task.duration": 3.0} | quiet).resolve()
    simulation, action = lissajous_env.Simulation(made), np.array([0.4, 0.2], np.float32)
    places = [simulation.robots.measured.numpy()[0, 0].copy()]
    for _ in range(30):
        simulation.step(np.broadcast_to(action, (1, 5, 2)))
        places.append(simulation.robots.measured.numpy()[0, 0].copy())
    places, time = np.array(places), 0.1 * np.arange(31)
    command = np.repeat(inputs_of(made.robot, action[None]), 30, axis=0)
    own = [simulation.robots.wheelbase.numpy()[0, 0], made.robot.drag, simulation.robots.drive.numpy()[0, 0]]
    constants = np.array([[*own, made.robot.offset, made.robot.dead_zone, 0.0]])
    rollouts = Rollouts(made.robot, np.array([0, 31]), time, time[:-1], command)
    predicted = rollouts.predict(constants, np.pad(places[None, :1], ((0, 0), (0, 0), (0, 1))))[0]
    np.testing.assert_allclose(predicted[:, [0, 1, 3]], places[:, [0, 1, 3]], atol=2e-5)
    np.testing.assert_allclose(np.cos(predicted[:, 2] - places[:, 2]), 1, atol=1e-9)


def test_actions_and_commands_are_inverse():
    action = np.random.default_rng(0).uniform(-1, 1, (7, 3, 2)).astype(np.float32)
    np.testing.assert_allclose(actions_of(Robot(), inputs_of(Robot(), action)), action, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, c: (Track(t.time[:10], t.position[:10], t.heading[:10], t.speed[:10]), c), "at least 20 poses"),
        (lambda t, c: (standing(t), c), "whose speed and steering change"),
        (lambda t, c: (t, Series(c.time, 0 * c.value)), "whose speed and steering change"),
        (lambda t, c: (t, Series(c.time, c.value, ("steer", "gas"))), r"steering \[rad\] and throttle, got steer, gas"),
        (lambda t, c: (t, Series(c.time, c.value[:, :1])), "got 1 numbers without names"),
        (lambda t, c: (t, Series(c.time, c.value * (57.3, 1))), "is it in degrees"),
    ],
)
def test_a_log_that_shows_nothing_is_refused(change, words):
    ((track, commands, _),) = drive([0], **{"task.duration": 10.0})
    with pytest.raises(ValueError, match=words):
        identify(*change(track, commands))


@pytest.mark.parametrize("noise", [{}, {"noise.position": 0.01, "noise.heading": 0.02}])
@pytest.mark.parametrize("seed", [1, 5])
def test_logged_speeds_count_exactly_if_they_lead_from_pose_to_pose(seed, noise):
    # Law: however fast a car turns between two poses, its speeds are used; no others are.
    for track, *_ in drive(
        [0, 1],
        seed=seed,
        faster=True,
        **{name: noise.get(name, 0.0) for name in ("noise.position", "noise.heading", "noise.speed")},
    ):
        assert motion_of(track).derived == ""
        for wrong in (0 * track.speed, 3 * track.speed, -track.speed):
            changed = Track(track.time, track.position, track.heading, wrong)
            assert motion_of(changed).derived == "do not match the poses"
