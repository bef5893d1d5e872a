"""The rule by which cars stay inside walls, as laws: a car with a way out keeps one, meets no wall, and moves on."""

import numpy as np
import pytest
import warp as wp
from choices import Reckless, playing_all

import baselines
import lissajous_env
from baselines.policies.base import UnsuitableScenarioError
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.world.robots.inside import Walls, is_safe, walls_of

pytestmark = pytest.mark.filterwarnings("ignore::lissajous_env.parameters.assumptions.AssumptionWarning")

EXACT = {"noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0, "robot.drive_factors": (), "faults.schedule": ()}
WALLS = {
    "task.boundary": "wall",
    "formation.start": "rotated",
    "targets.arrival_rate": 0.0,
    "targets.count": 0,
    "task.contamination": None,
}
WORLDS = 16


@wp.kernel
def check_safe(walls: Walls, robot: RobotStruct, cars: wp.array(dtype=wp.vec4), safe_out: wp.array(dtype=int)):
    k = wp.tid()
    safe_out[k] = wp.where(is_safe(walls, robot, cars[k]), 1, 0)


def have_way_out(scenario, cars):
    """Return whether cars (..., 4) of x, y, heading and speed have a way out."""
    rows = wp.array(cars.reshape(-1, 4), dtype=wp.vec4, device="cpu")
    safe = wp.zeros(len(rows), dtype=wp.int32, device="cpu")
    inputs = [walls_of(scenario), to_struct(RobotStruct, scenario.robot), rows]
    wp.launch(check_safe, len(rows), inputs, outputs=[safe], device="cpu")
    return safe.numpy().reshape(cars.shape[:-1]) == 1


class Straight(baselines.Policy):
    """Drives straight on at full throttle."""

    def decide(self, observation):
        wanted = np.full(self.action.shape, 0.5)
        wanted[..., :2] = 0.0, 1.0
        return wanted


class Fast(Reckless):
    def draw(self):
        drawn = np.clip(self.random.normal(size=self.wanted.shape) * 1.2, -1, 1)
        drawn[..., 1] = self.random.choice([1.0, 1.0, 0.3, -1.0], size=self.shape)
        return drawn


def drive(scenario, policy, steps, cars=None):
    """Yield x, y, heading, speed (W, N, 4) of the cars before each step; `cars` are those at the beginning."""
    simulation = lissajous_env.Simulation(scenario, policy.num_worlds, seed=3)
    robots = simulation.robots
    if cars is not None:
        robots.position.assign(np.concatenate([cars[..., :2], np.zeros_like(cars[..., :1])], axis=2))
        robots.heading.assign(cars[..., 2])
        robots.speed.assign(cars[..., 3])
    for _ in range(steps):
        place, heading, speed = (array.numpy() for array in (robots.position, robots.heading, robots.speed))
        yield np.concatenate([place[..., :2], heading[..., None], speed[..., None]], axis=2)
        simulation.step(policy.act(simulation.observation))


def closeness(scenario, cars):
    """Return the distance of bodies (W, N) from the nearest wall [m]."""
    half = np.array([scenario.curve.half_width, scenario.curve.half_height]) - scenario.robot.radius
    return (half - np.abs(cars[..., :2])).min(axis=2)


HALLS = {
    "narrow": ("evaders", {"curve.half_height": 0.72, "curve.half_width": 3.0}),
    "fast": ("experiment", {"curve.half_width": 2.5, "curve.half_height": 1.5}),
    "slippery": ("intruders", {"curve.half_width": 3.0}),
    "very slippery": ("intruders", {"robot.lateral_acceleration_max": 2.0, "robot.throttle_max": 0.2}),
    "short steps": ("evaders", {"task.step": 0.02}),
    "reversing on ice": ("intruders", {"robot.speed_min": -1.0, "robot.lateral_acceleration_max": 2.0}),
    "square": ("team", {"curve.half_width": 1.5, "curve.half_height": 1.5}),
}


@pytest.mark.parametrize(("name", "fields"), HALLS.values(), ids=HALLS)
def test_a_car_with_a_way_out_keeps_one_meets_no_wall_and_moves_on(name, fields):
    scenario = lissajous_env.scenario(name, **(EXACT | WALLS | fields)).resolve()
    policy = Fast(scenario, WORLDS)
    had = np.zeros(policy.shape, dtype=bool)
    way, steps = np.zeros(policy.shape), np.zeros(policy.shape)
    before, lost = None, 0
    for cars in drive(scenario, policy, 160):
        safe = have_way_out(scenario, cars)
        lost += (had & ~safe).sum()
        assert not (had & (closeness(scenario, cars) < 0.005 * scenario.robot.radius)).any()
        if before is not None:
            way += had * np.linalg.norm(cars[..., :2] - before[..., :2], axis=2)
            steps += had
        had, before = had | safe, cars
    assert lost <= 1e-3 * steps.sum()  # rounding
    assert had.all()
    speed = way / np.maximum(steps * scenario.task.step, scenario.task.step)
    assert (speed[steps > 80] > 0.05 * scenario.robot.top_speed).all()


@pytest.mark.parametrize(("name", "reverse"), [("evaders", None), ("intruders", -0.5)])
def test_a_car_that_stands_at_a_wall_frees_itself(name, reverse):
    scenario = lissajous_env.scenario(name, **(EXACT | WALLS | {"robot.speed_min": reverse})).resolve()
    policy = Straight(scenario, WORLDS)
    half = np.array([scenario.curve.half_width, scenario.curve.half_height]) - scenario.robot.radius
    cars = np.zeros((*policy.shape, 4))
    cars[..., 0] = half[0]
    cars[..., 1] = np.linspace(-0.6, 0.6, policy.shape[1]) * half[1]
    cars[..., 2] = np.linspace(-1.4, 1.4, WORLDS)[:, None]
    *_, last = drive(scenario, policy, round(20 * scenario.time_unit / scenario.task.step), cars)
    assert have_way_out(scenario, last).all()


def test_the_rule_decides_where_there_are_walls_for_every_car_policy_and_after_filters_without_walls_of_their_own():
    walls = lissajous_env.scenario("evaders", **WALLS)
    assert baselines.make("sweep", "evaders")._stay_inside is None
    for name in ("sweep", "kuramoto-mpcc", "random", "sweep-safe"):
        assert baselines.make(name, walls)._stay_inside is not None
    filtered = baselines.make("sweep-proved", walls)
    assert filtered._stay_inside is None
    assert filtered.policy._stay_inside is not None
    corridor = {"curve.half_height": 0.5, "sensing.radius": 1.0}
    assert baselines.make("sweep", lissajous_env.scenario("evaders", **(WALLS | corridor)))._stay_inside is None


@pytest.mark.parametrize("name", ["random", "sweep", "kuramoto-mpcc", "sweep-safe", "random-proved"])
def test_no_policy_meets_a_wall_or_is_blocked_by_one(name):
    scenario = lissajous_env.scenario("evaders", **{"task.boundary": "wall", "task.contamination": None})
    for row in lissajous_env.evaluate(baselines.make(name, scenario, 4), scenario, range(4)):
        assert row["wall_contacts"] == 0
        assert name.endswith("-proved") or row["blocked_time"] == 0
        assert row["distance_mean"] > 1.0
        assert not name.endswith("-proved") or row["collisions"] == 0


SMALL = {"task.boundary": "wall", "task.contamination": None, "task.duration": 8.0}
SHIPPED = [
    (kind, name)
    for kind in ("car", "differential")
    for name in playing_all(baselines.names(lissajous_env.scenario("evaders", **SMALL, **{"robot.kind": kind})))
]


@pytest.mark.parametrize(("kind", "name"), SHIPPED)
def test_every_included_policy_of_cars_and_drives_stays_inside_or_refuses(kind, name):
    scenario = lissajous_env.scenario("evaders", **SMALL, **{"robot.kind": kind})
    try:
        policy = baselines.make(name, scenario, 2)
    except UnsuitableScenarioError as refusal:
        assert str(refusal).startswith("line-abreast requires ")  # noqa: PT017 -- other policies accept the scenario
        assert name.startswith("line-abreast")
        return
    for row in lissajous_env.evaluate(policy, scenario, range(2)):
        assert row["wall_contacts"] == row["partly_outside_time"] == 0


def test_messages_and_actions_that_leave_a_way_out_pass():
    scenario = lissajous_env.scenario("hall", **(WALLS | {"messages.size": 2}))
    simulation = lissajous_env.Simulation(scenario, 4, seed=1)
    policy = Straight(scenario, 4)
    action = policy.act(simulation.observation).numpy()
    assert (action[..., 2:] == 0.5).all()
    place = simulation.robots.position.numpy()[..., :2]
    inner = (np.abs(place) < [12.0, 6.0]).all(axis=2)
    assert inner.any()
    assert (action[inner][:, :2] == [0.0, 1.0]).all()
