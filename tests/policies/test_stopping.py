"""The rule by which differential drives stay inside walls, as laws, with the simulated drives as the oracle."""

import numpy as np
import pytest
from choices import Reckless

import baselines
import lissajous_env

pytestmark = pytest.mark.filterwarnings("ignore::lissajous_env.parameters.assumptions.AssumptionWarning")

DRIVES = {"robot.kind": "differential", "task.boundary": "wall", "formation.start": "rotated", "task.duration": 20.0}
EXACT = {"noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0, "faults.schedule": ((0, 4.0, 6.0),)}
HALLS = {
    "narrower than the circles of cars": ("experiment", {}),
    "slippery": ("intruders", {"robot.lateral_acceleration_max": 1.0}),
    "without reverse": ("evaders", {"robot.speed_min": 0.0}),
    "slow turns": ("evaders", {"robot.yaw_acceleration_max": 8.0}),
    "corridor": ("evaders", {"curve.half_height": 0.2, "sensing.radius": 1.0, "task.contamination": None}),
}


class Fast(Reckless):
    def draw(self):
        return np.clip(self.random.normal(size=self.wanted.shape) * [1.5, 0.3], -1, 1)


class Straight(baselines.Policy):
    """Drives straight on at full speed."""

    def decide(self, observation):
        return np.broadcast_to([1.0, 0.0], self.action.shape)


def drive(policy, simulation, gap, check=lambda: None):
    """Drive until the end of the episode; no body comes nearer to a wall than `gap` [m], and each moves on."""
    scenario, robots, way = simulation.scenario, simulation.robots, np.zeros(policy.shape)
    half = np.array([scenario.curve.half_width, scenario.curve.half_height]) - scenario.robot.radius
    for _ in range(scenario.task.steps - 1):
        before = robots.position.numpy()[..., :2].copy()
        simulation.step(policy.act(simulation.observation))
        place = robots.position.numpy()[..., :2]
        way += np.linalg.norm(place - before, axis=2)
        assert (np.abs(place) < half - gap).all()
        check()
    assert (way > 0.02 * scenario.robot.top_speed * scenario.task.duration).all()


@pytest.mark.parametrize(("name", "fields"), HALLS.values(), ids=HALLS)
def test_a_drive_meets_no_wall_moves_on_and_knows_its_yaw_rate(name, fields):
    scenario = lissajous_env.scenario(name, **(EXACT | DRIVES | fields)).resolve()
    policy = Fast(scenario, 16)
    simulation = lissajous_env.Simulation(scenario, 16, seed=3)
    robots = simulation.robots

    def check():
        known = np.where(robots.status.numpy() == 0, policy._stay_inside.yaw_rate.numpy(), 0)
        np.testing.assert_allclose(known, robots.yaw_rate.numpy(), atol=1e-3)

    drive(policy, simulation, 0.005 * scenario.robot.radius, check)
    policy.reset(np.arange(16) == 2)
    assert [(policy._stay_inside.yaw_rate.numpy()[w] == 0).all() for w in (2, 3)] == [True, False]


@pytest.mark.parametrize("fields", [{}, {"robot.speed_min": 0.0}], ids=["with reverse", "without reverse"])
def test_noise_that_adds_up_while_drives_brake_leads_none_to_a_wall(fields):
    scenario = lissajous_env.scenario("rough", **(DRIVES | fields)).resolve()
    simulation = lissajous_env.Simulation(scenario, 16, seed=3)
    drive(Fast(scenario, 16), simulation, 0.0)
    assert (simulation.clock.step.numpy() == scenario.task.steps - 1).all()


@pytest.mark.parametrize("axis", [0, 1])
def test_mirrored_drives_act_alike(axis):
    """Law: a mirror image, with motors and wheels that differ."""
    noise = {"noise.wheelbase_spread": 0.05, "noise.drive_spread": 0.2, "noise.heading": 0.05, "noise.actuator": 0.05}
    policy = Straight(lissajous_env.scenario("evaders", **(DRIVES | noise)), 400)
    rows = np.random.default_rng(0).uniform(-1, 1, policy.observation_shape)
    rows[..., 7] = 1
    action = policy.act(rows)
    policy.reset()
    rows[..., [axis, 2 + axis]] *= -1
    np.testing.assert_allclose(policy.act(rows) * [1, -1], action, atol=1e-3)


def test_ways_to_stop_end_at_rest():
    """Law: more time for braking changes nothing, also at speeds that are measured above the top speed."""
    scenario = lissajous_env.scenario("evaders", **(EXACT | DRIVES), **{"noise.speed": 0.3})
    policy = Straight(scenario, 4000)
    rows = np.random.default_rng(0).uniform(-1, 1, policy.observation_shape)
    rows[..., 4], rows[..., 7] = rows[..., 4] * (1 + 3 * 0.3 / scenario.robot.top_speed), 1
    action = policy.act(rows)
    policy.reset()
    policy._stay_inside._inputs[0].braking *= 10
    np.testing.assert_array_equal(policy.act(rows), action)


def test_a_drive_that_stands_at_a_wall_turns_on_the_spot_and_leaves_it():
    scenario = lissajous_env.scenario("evaders", **(EXACT | DRIVES)).resolve()
    policy, simulation = Straight(scenario, 8), lissajous_env.Simulation(scenario, 8, seed=3)
    robots, edge = simulation.robots, scenario.curve.half_width - scenario.robot.radius
    place = np.zeros((*policy.shape, 3))
    place[..., 0], place[..., 1] = edge, np.linspace(-0.5, 0.5, policy.shape[1])
    robots.position.assign(place)
    robots.heading.assign(np.linspace(-1.4, 1.4, 8)[:, None] + np.zeros(policy.shape))
    robots.speed.assign(np.zeros(policy.shape))
    for _ in range(30):
        simulation.step(policy.act(simulation.observation))
        assert (robots.position.numpy()[..., 0] <= edge + 1e-6).all()
    assert (robots.position.numpy()[..., 0] < edge - scenario.robot.radius).all()
