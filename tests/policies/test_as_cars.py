"""Policies of cars on robots of other models, differential drives; test_extending.py has a model of one's own."""

import dataclasses

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
from baselines.planning.families import formations, lines, loops, partitions
from baselines.policies.as_cars import scenario_of_cars
from baselines.policies.registry import as_factory
from baselines.policies.settings import PolicySettings
from lissajous_env.device.structs import RobotStruct
from lissajous_env.parameters import robot_models

DRIVES = lissajous_env.scenario("evaders", **{"robot.kind": "differential", "task.duration": 20.0})
ACT = robot_models.model_of("differential").as_car.act
SHORT = lissajous_env.scenario(DRIVES, **{"task.duration": 1.0})


def test_every_classical_policy_of_cars_drives_robots_that_move_like_cars():
    listed = set(baselines.names(DRIVES))
    assert {"partition", "partition-repair", "line-abreast-safe", "kuramoto-mpcc-safe", "sweep", "random"} <= listed
    assert not [name for name in listed if name.endswith("-proved") or name.startswith("learned")]
    for name in listed - {name for name in listed if name.endswith("-safe")} | {"sweep-safe"}:
        row = lissajous_env.evaluate(baselines.make(name, SHORT), SHORT, seeds=[0])[0]
        assert row["distance_mean"] > 0.1 or name.startswith("still"), name


@pytest.mark.parametrize("name", ["partition", "partition-repair", "line-abreast", "kuramoto-mpcc"])
def test_partitions_and_formations_keep_their_guarantee_on_other_wheels(name):
    """Oracle: cars with the same top speed, turning radius and acceleration."""
    rows, of_cars = (
        lissajous_env.evaluate(baselines.make(name, scenario, 2), scenario, range(2))
        for scenario in (DRIVES, scenario_of_cars(DRIVES.resolve()))
    )
    longest, wanted = (np.mean([row["guaranteed_detection_time"] for row in episodes]) for episodes in (rows, of_cars))
    assert longest < 1.15 * wanted + DRIVES.task.step
    assert sum(row["collisions"] for row in rows) == 0 or name == "kuramoto-mpcc"


@pytest.mark.parametrize(("name", "share"), [("evaders", 1.0), ("experiment", 0.58), ("hall", 1.0)])
def test_a_drive_gains_the_yaw_rate_of_every_circle_within_one_radius_of_way(name, share):
    """Oracle: closed form, R = v / sqrt(yaw acceleration), on the tightest circle that steering and grip allow."""
    drives = lissajous_env.scenario(name, **{"robot.kind": "differential"}).resolve()
    cars = scenario_of_cars(drives).robot
    assert scenario_of_cars(lissajous_env.scenario(drives, **{"robot.steering_max": 1.0}).resolve()).robot == cars
    speed = np.linspace(0.01, 1, 100) * cars.top_speed
    radius = np.maximum(cars.wheelbase / np.tan(cars.steering_max), speed**2 / cars.lateral_acceleration_max)
    wider = radius / speed * np.sqrt(drives.robot.top_yaw_acceleration)
    assert (wider > 0.999).all()
    assert speed[np.argmin(wider)] == pytest.approx(share * cars.top_speed, rel=0.02)


def test_the_filter_predicts_the_yaw_rate_of_a_drive():
    """Oracle: the simulated drives; the predicted speed, by the midpoint rule, differs from theirs by less than 1 %."""
    drives = lissajous_env.scenario(DRIVES, **{"noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0})
    simulation, policy = lissajous_env.Simulation(drives, 3), baselines.make("sweep-safe", drives, 3)
    for _ in range(20):
        simulation.step(policy.act(simulation.observation))
        yaw_rate = simulation.robots.yaw_rate.numpy()
        np.testing.assert_allclose(policy.policy.filter._yaw_rate.numpy(), yaw_rate, rtol=0.01, atol=0.01)
        assert np.abs(yaw_rate).max() > 2


def test_a_world_depends_on_its_own_observation_alone():
    scenario = lissajous_env.scenario(SHORT, **{"messages.size": 2})
    together = lissajous_env.evaluate(baselines.make("partition-repair-safe", scenario, 3), scenario, range(3))
    alone = lissajous_env.evaluate(baselines.make("partition-repair-safe", scenario, 1), scenario, [2])
    np.testing.assert_equal(alone[0], {**together[2], "episode": 0})


def test_the_search_tries_for_other_wheels_what_it_tries_for_cars():
    """Law: the same settings of every family, and a plan of each on the robots' own scenario, which makes a policy."""
    cars = scenario_of_cars(DRIVES.resolve())
    for family_of in (partitions, lines, formations, loops):
        family, of_cars = family_of(DRIVES), family_of(cars)
        assert not family.refusal
        assert family.first == of_cars.first
        assert family.choices == of_cars.choices | ({"turning": (1.0, 8.0)} if family.name == "partition" else {})
        for settings in family.first[:2]:
            plan = family.plan(settings)
            assert plan.settings == of_cars.plan(settings).settings
            assert plan.scenario.robot.kind == "differential"
    policy = PolicySettings("partition", {"rows": 1}).make(DRIVES)
    assert (policy.kind, policy.name) == ("differential", "partition")


def test_messages_follow_the_action():
    scenario = lissajous_env.scenario(SHORT, **{"messages.size": 3})

    class Speaker(baselines.Policy):
        kind = "car"

        def decide(self, observation):
            return np.broadcast_to(np.float32([0.0, -1.0, 0.1, 0.2, 0.3]), self.action.shape)

    action = (policy := as_factory(Speaker)(scenario, 2, "cpu")).act(np.zeros(policy.observation_shape, np.float32))
    np.testing.assert_allclose(action[..., 2:], np.broadcast_to(np.float32([0.1, 0.2, 0.3]), (*policy.shape, 3)))


@pytest.mark.parametrize("name", ["partition-proved", "portfolio"])
def test_policies_for_cars_alone_are_refused_by_name(name):
    with pytest.raises(ValueError, match=f"must drive robots of kind .*got {name}, which drives kind car"):
        baselines.make(name, DRIVES)


def test_a_class_of_a_user_drives_robots_of_its_kind_alone():
    class Boat(baselines.Policy):
        kind = "boat"

    with pytest.raises(ValueError, match=r"kind of Boat must be differential, .* or None, got 'boat'"):
        Boat(DRIVES)
    with pytest.raises(ValueError, match="must drive robots of kind differential, got Boat, which drives kind boat"):
        as_factory(Boat)(DRIVES, 1, "cpu")


@wp.kernel
def mute(robot: RobotStruct, action_out: wp.array3d(dtype=float)):
    """Write nothing."""


@pytest.mark.parametrize(("as_car", "rule"), [
    ("fast", "as_car of robot model odd must be an AsCar, got 'fast'"),
    (lissajous_env.AsCar(print, float, float), "as_car.act of robot model odd must be a Warp kernel of robot, "),
    (lissajous_env.AsCar(mute, float, float), r"yaw_rate, action_out, got \['robot', 'action_out'\]"),
    (lissajous_env.AsCar(ACT, lambda robot: 0.0, lambda robot: 6.0),
     "as_car.turning_radius of robot model odd must be above 0, got 0.0"),
])  # fmt: skip
def test_what_does_not_say_how_to_move_like_a_car_is_refused(as_car, rule):
    odd = dataclasses.replace(robot_models.model_of("differential"), name="odd", as_car=as_car)

    def make():
        lissajous_env.register_robot_model(odd)
        scenario_of_cars(lissajous_env.scenario("evaders", **{"robot.kind": "odd"}).resolve())

    with pytest.raises(ValueError, match=rule):
        make()
