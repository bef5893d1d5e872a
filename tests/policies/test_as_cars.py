"""Policies of cars on robots of other models: differential drives, wheels for every direction, and others."""

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
from baselines.planning.families import formations, lines, partitions, patrols
from baselines.policies.as_cars import AsCars, scenario_of_cars
from baselines.policies.settings import PolicySettings
from lissajous_env.device.part_structs import RobotStruct, TaskStruct
from lissajous_env.episodes.guarantee import worst_undetected_times
from lissajous_env.parameters import robot_models
from lissajous_env.world.state import WORKING, Clock, Robots

TOP = 3.0
"""Top speed of the model [m/s]."""


@wp.func
def put(w: int, i: int, velocity: wp.vec2, heading: float, speed: float, step: float, robots: Robots):
    """Move a robot in a straight line."""
    old = robots.position[w, i]
    new = old + step * wp.vec3(velocity[0], velocity[1], 0.0)
    for s in range(robots.track.shape[2]):
        robots.track[w, i, s] = wp.lerp(old, new, float(s) / float(robots.track.shape[2] - 1))
    robots.position[w, i] = new
    robots.heading[w, i] = heading
    robots.speed[w, i] = speed


@wp.kernel
def in_every_direction(
    first: int, lanes: int, task: TaskStruct, command: wp.array3d(dtype=float), clock: Clock, robots: Robots
):
    """Move with the velocity of the action; the heading is its direction."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 1:
        for i in range(lane, robots.status.shape[1], lanes):
            velocity = TOP * wp.vec2(command[w, i, 0], command[w, i, 1])
            velocity = velocity / wp.max(wp.length(velocity) / TOP, 1.0)
            if robots.status[w, i] != WORKING:
                velocity = wp.vec2()
            heading = robots.heading[w, i]
            if wp.length(velocity) > 0.0:
                heading = wp.atan2(velocity[1], velocity[0])
            put(w, i, velocity, heading, wp.length(velocity), task.step, robots)


@wp.kernel
def to_velocity(
    robot: RobotStruct,
    heading: wp.array2d(dtype=float),
    speed: wp.array2d(dtype=float),
    yaw_rate: wp.array2d(dtype=float),
    action_out: wp.array3d(dtype=float),
):
    """Write the velocity at the end of a step of 0.1 s."""
    w, i = wp.tid()
    direction = heading[w, i] + 0.1 * yaw_rate[w, i]
    action_out[w, i, 0] = wp.clamp(speed[w, i] / TOP * wp.cos(direction), -1.0, 1.0)
    action_out[w, i, 1] = wp.clamp(speed[w, i] / TOP * wp.sin(direction), -1.0, 1.0)


def model(name, move, act, turning_radius=0.35, acceleration=6.0):
    as_car = lissajous_env.AsCar(act, lambda robot: turning_radius, lambda robot: acceleration)
    table = ((0.0, 0.0), (1.0, 1.0))
    return lissajous_env.RobotModel(name, ("one", "other"), table, move, lambda *parts: TOP, as_car=as_car)


HOLONOMIC = in_every_direction, to_velocity


@pytest.fixture
def register(monkeypatch):
    """Register a model for one test."""
    monkeypatch.setattr(robot_models, "_MODELS", dict(robot_models._MODELS))
    return lissajous_env.register_robot_model


@pytest.fixture(params=["differential", "holonomic"])
def evaders(request, register):
    """Scenario of robots of a model."""
    register(model("holonomic", *HOLONOMIC))
    return lissajous_env.scenario("evaders", **{"robot.kind": request.param})


def test_every_classical_policy_of_cars_drives_robots_that_move_like_cars(evaders):
    listed = set(baselines.names(evaders))
    assert {"partition", "partition-repair", "line-abreast-safe", "kuramoto-mpcc-safe", "sweep", "random"} <= listed
    assert not [name for name in listed if name.endswith("-proved") or name.startswith("learned")]
    short = lissajous_env.scenario(evaders, **{"task.duration": 1.0})
    for name in listed:
        row = lissajous_env.evaluate(baselines.make(name, short, 2), short, seeds=[0, 1])[0]
        assert row["distance_mean"] > 0.1 or name.startswith("still"), name


def test_partitions_and_lines_keep_their_guarantee_on_other_wheels(evaders):
    # Oracle: cars with the same top speed, turning radius and acceleration.
    seeds, cars = range(8), scenario_of_cars(evaders.resolve())
    for name in ("partition", "partition-repair", "kuramoto-mpcc"):
        longest = [
            worst_undetected_times(baselines.make(name, made, len(seeds)), made, seeds).max(axis=1)
            for made in (evaders, cars)
        ]
        assert longest[0].mean() < 1.15 * longest[1].mean() + evaders.task.step, name
        rows = lissajous_env.evaluate(baselines.make(name, evaders, len(seeds)), evaders, seeds)
        assert sum(row["collisions"] for row in rows) == 0 or name == "kuramoto-mpcc", name


def test_a_holonomic_robot_follows_as_closely_as_the_car(register):
    # The same path, up to what the motor of a car adds within a step.
    register(model("holonomic", *HOLONOMIC))
    made = lissajous_env.scenario("evaders", **{"robot.kind": "holonomic"})
    error = {
        each.robot.kind: lissajous_env.evaluate(baselines.make("kuramoto-mpcc", each, 8), each, range(8))
        for each in (made, scenario_of_cars(made.resolve()))
    }
    lateral = {kind: np.mean([row["lateral_error_mean"] for row in rows]) for kind, rows in error.items()}
    assert lateral["holonomic"] < 1.5 * lateral["car"] + 0.01


def test_a_world_depends_on_its_own_observation_alone(evaders):
    made = lissajous_env.scenario(evaders, **{"task.duration": 2.0, "messages.size": 2})
    together = lissajous_env.evaluate(baselines.make("partition-repair-safe", made, 3), made, range(3))
    alone = lissajous_env.evaluate(baselines.make("partition-repair-safe", made, 1), made, [2])
    np.testing.assert_equal(alone[0], {**together[2], "episode": 0})


def test_a_plan_for_other_wheels_is_found_among_the_policies_for_cars(evaders):
    found = baselines.plan(evaders, plans=24)
    assert found.finals
    made = PolicySettings("partition", {"rows": 1}).make(evaders)
    assert made.kind == evaders.robot.kind
    assert made.name == "partition"


def test_the_search_tries_for_other_wheels_what_it_tries_for_cars(evaders):
    # Law: the same settings of every family, and a plan of each on the robots' own scenario.
    cars = scenario_of_cars(evaders.resolve())
    for family_of in (partitions, lines, formations, patrols):
        family, of_cars = family_of(evaders), family_of(cars)
        assert not family.refusal
        assert (family.starts, family.space) == (of_cars.starts, of_cars.space)
        for settings in family.starts[:2]:
            plan = family.plan(settings)
            assert plan.settings == of_cars.plan(settings).settings
            assert plan.scenario.robot.kind == evaders.robot.kind


def test_messages_follow_the_action(evaders):
    made = lissajous_env.scenario(evaders, **{"messages.size": 3})

    class Speaker(baselines.Policy):
        kind = "car"

        def decide(self, observation):
            return np.broadcast_to(np.float32([0.0, -1.0, 0.1, 0.2, 0.3]), self.action.shape)

    policy = AsCars(Speaker, made, 2)
    action = policy.act(np.zeros(policy.observation_shape, np.float32))
    np.testing.assert_allclose(action[..., 2:], np.broadcast_to(np.float32([0.1, 0.2, 0.3]), (*policy.shape, 3)))


def test_a_robot_that_says_no_turning_radius_is_refused_by_name(register):
    register(model("stiff", *HOLONOMIC, turning_radius=0.0))
    made = lissajous_env.scenario("evaders", **{"robot.kind": "stiff"})
    with pytest.raises(ValueError, match=r"as_car.turning_radius of robot model stiff must be above 0, got 0.0"):
        baselines.make("partition", made)


def test_policies_for_cars_alone_are_refused_by_name(evaders):
    for name in ("partition-proved", "portfolio"):
        with pytest.raises(ValueError, match=f"must drive robots of kind .*got {name}, which drives kind car"):
            baselines.make(name, evaders)


@wp.kernel
def mute(robot: RobotStruct, action_out: wp.array3d(dtype=float)):
    """Write nothing."""


@pytest.mark.parametrize(
    ("as_car", "rule"),
    [
        ("fast", "as_car of robot model odd must be an AsCar, got 'fast'"),
        (lissajous_env.AsCar(print, float, float), "as_car.act of robot model odd must be a Warp kernel of robot, "),
        (lissajous_env.AsCar(mute, float, float), "yaw_rate, action_out, got robot, action_out"),
    ],
)
def test_what_does_not_say_how_to_move_like_a_car_is_refused(as_car, rule):
    odd = lissajous_env.RobotModel("odd", ("a",), ((0.0,),), in_every_direction, lambda *parts: 1.0, as_car=as_car)
    with pytest.raises(ValueError, match=rule):
        lissajous_env.register_robot_model(odd)
