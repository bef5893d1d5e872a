"""The law of similarity: lengths times L and times times T change nothing in scaled units.

Where L is a power of 2 and T one of 4, scaling moves exponents alone, so every observation must keep its bits, for any
policy. Other factors round differently, so there only means can be compared: an episode with a collision soon differs.
"""

import numpy as np
import pytest
from choices import differing
from test_feedback import FIELD

import baselines
import lissajous_env

pytestmark = pytest.mark.filterwarnings("ignore::lissajous_env.parameters.assumptions.AssumptionWarning")

EXACT = ((2.0, 4.0), (1 / 8, 1.0), (64.0, 16.0))
BACK = {"robot.speed_min": -1.0, "task.boundary": "wall"}
FEEDBACK = FIELD | {
    "sensing.sight": 8.0, "targets.respawn": True, "targets.entry": "hotspots", "targets.hotspot_spread": 2.5,
    "targets.speed_min": 0.25, "targets.flight": "all",
}  # fmt: skip
TRACKS = FIELD | {
    "targets.leave": False, "sensing.sight": 5.0, "sensing.tracks_seen": 12, "sensing.teammates_seen": 4,
    "sensing.cells_seen": (8, 5), "sensing.shared": "team", "noise.message_delay": 1.0, "noise.message_loss": 0.4,
}  # fmt: skip
STORIES = {
    "rough": ("rough", {}),
    "points": ("failure", {}),
    "in space": ("knot", {}),
    "grip and a larger rectangle": ("intruders", {}),
    "contamination": ("evaders", {}),
    "walls and cars that reverse": ("rough", BACK),
    "walls and differential drives": ("rough", BACK | {"robot.kind": "differential"}),
    "targets that appear anew around hotspots": ("intruders", FEEDBACK),
    "tracks": ("intruders", TRACKS),
    "velocities": ("intruders", FIELD | {"task.action": "velocity"}),
    "rogues": ("evaders", {"rogues": "shadow", "targets.count": 8}),
}
UNITS = {"time": (0, 1), "idleness": (0, 1), "distance": (1, 0), "error_m": (1, 0), "min_": (1, 0), "speed": (1, -1)}


def observations(scenario, policy=None, steps=60, seed=3):
    """(steps, W, N, D) observations under a policy, or under the same random actions for every scale; and the score."""
    sim = lissajous_env.Simulation(scenario, num_worlds=2, seed=seed)
    sim.reset()
    driver = baselines.make(policy, scenario, num_worlds=2) if policy else None
    draws, seen = np.random.default_rng(0), []
    for step in range(steps):
        if step % 5 == 0:
            drawn = draws.uniform(-1, 1, sim.action_shape).astype(np.float32)
        sim.step(driver.act(sim.observation) if driver else drawn)
        seen.append(sim.observation.numpy().ravel())
        if sim.rogues is not None:
            seen[-1] = np.concatenate([seen[-1], sim.rogues.observation.numpy().ravel()])
    return np.array(seen), sim.score()


@pytest.mark.parametrize("name", STORIES)
def test_a_world_keeps_its_bits_at_another_scale(name):
    scenario = lissajous_env.scenario(STORIES[name][0], **STORIES[name][1])
    seen, score = observations(scenario)
    for length, time in EXACT:
        scaled, scaled_score = observations(scenario.scaled(length, time))
        np.testing.assert_array_equal(scaled, seen)
        for column, value in score[0].items():
            for part, (of_length, of_time) in UNITS.items():
                if part in column and not column.startswith("phase"):
                    expected = value * length**of_length * time**of_time
                    assert scaled_score[0][column] == pytest.approx(expected, rel=1e-6, abs=1e-9, nan_ok=True), column
    if BACK.items() <= STORIES[name][1].items():
        assert min(row["wall_contacts"] for row in score) > 0


@pytest.mark.parametrize(
    "policy", [name for name in differing(baselines.names("rough")) if not name.startswith("line-abreast")]
)
def test_a_car_policy_keeps_its_bits_at_another_scale(policy):
    # Noise, lost messages and faults are in `rough`.
    scenario = lissajous_env.scenario("rough")
    seen, _ = observations(scenario, policy, steps=30)
    length, time = EXACT[len(policy) % len(EXACT)]
    np.testing.assert_array_equal(observations(scenario.scaled(length, time), policy, steps=30)[0], seen)


@pytest.mark.parametrize("policy", ["kuramoto", "consensus"])
def test_a_policy_of_points_keeps_its_bits_at_another_scale(policy):
    scenario = lissajous_env.scenario("failure", **{"noise.message_loss": 0.3, "faults.schedule": ((0, 1.0, 3.0),)})
    seen, _ = observations(scenario, policy)
    np.testing.assert_array_equal(observations(scenario.scaled(64.0, 16.0), policy)[0], seen)


def test_the_unit_of_the_throttle_does_not_matter():
    scenario = lissajous_env.scenario("experiment", **{"noise.drive_spread": 0.0})
    seen, _ = observations(scenario, "kuramoto-mpcc")
    percent = {"throttle_min": 12.8, "throttle_max": 32.0, "dead_zone": 12.8, "drive": 36.81 / 128}
    percent = {f"robot.{name}": value for name, value in percent.items()}
    again, _ = observations(lissajous_env.scenario(scenario, **percent), "kuramoto-mpcc")
    np.testing.assert_array_equal(again, seen)


@pytest.mark.parametrize("factors", [(0.0, 1.0), (1.0, -2.0), (float("nan"), 1.0), ("2", 1.0), (True, 1.0)])
def test_a_scale_must_be_positive(factors):
    with pytest.raises(ValueError, match="must be a positive number, got"):
        lissajous_env.scenario("ideal").scaled(*factors)


def test_scaling_back_gives_the_scenario():
    for name in lissajous_env.scenarios():
        scenario = lissajous_env.scenario(name)
        assert scenario.scaled(np.float32(4.0), 16).scaled(1 / 4, 1 / 16) == scenario
        assert scenario.resolve().scaled(4.0, 16.0) == scenario.scaled(4.0, 16.0).resolve()
