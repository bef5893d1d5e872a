"""Scripted rogues: each does what it says, none outlasts the proved bound, and commands name them."""

import json

import numpy as np
import pytest
from command_line import called

import baselines
import lissajous_env
from lissajous_env import Simulation
from lissajous_env.world.rogues.acting import rogue_layout

SMALL = {"sensing.radius": 0.3, "targets.arrival_rate": 0.0, "targets.count": 8, "targets.entry": "unseen"}
BOUNDED = {"task.contamination": (36, 16), "task.conservative": True, "task.duration": 15.0}


def played(rogues, steps, policy="sweep", **settings):
    """A simulation after some steps, and the observations of rogues before each."""
    scenario = lissajous_env.scenario("experiment", rogues=rogues, **SMALL | settings)
    simulation, rows = Simulation(scenario, 2), []
    driver = baselines.make(policy, scenario, 2)
    for _ in range(steps):
        rows.append(simulation.rogues.observation.numpy().copy())
        simulation.step(driver.act(simulation.observation))
    return simulation, np.array(rows)


def entries(simulation, rows, *names):
    layout = rogue_layout(simulation.scenario)
    return np.moveaxis(rows[..., [layout.names.index(name) for name in names]], -1, 0)


def towards_nearest(simulation, rows):
    """Return each velocity towards where the nearest robot was [speed_limit], and True for rogues away from walls."""
    present, *velocity = entries(simulation, rows, "present", "x_velocity", "y_velocity")
    walls = np.min(entries(simulation, rows, "wall_left", "wall_right", "wall_bottom", "wall_top"), axis=0)
    x, y = entries(simulation, rows, "robot_0_x", "robot_0_y")
    away = np.stack([x * simulation.scenario.curve.half_width, y * simulation.scenario.curve.half_height])[:, :-1]
    away /= np.maximum(np.linalg.norm(away, axis=0), 1e-9)
    free = (present[:-1] == 1) & (present[1:] == 1) & (walls[1:] > 1e-3)
    return (away * np.array(velocity)[:, 1:]).sum(axis=0), free


def test_wander_goes_on_at_full_speed_and_turns_at_random():
    # Law: the speed is the limit away from walls; headings change by the deviation of `turn_rate`.
    simulation, rows = played("wander", 60, policy="still", **{"targets.turn_rate": 0.5})
    present, x, y = entries(simulation, rows, "present", "x_velocity", "y_velocity")
    walls = np.min(entries(simulation, rows, "wall_left", "wall_right", "wall_bottom", "wall_top"), axis=0)
    free = (present[1:] == 1) & (walls[1:] > 0.2) & (walls[:-1] > 0.2)
    assert free.sum() > 100
    assert np.hypot(x, y)[1:][free] == pytest.approx(1.0, abs=1e-4)
    angle = np.unwrap(np.arctan2(y, x), axis=0)
    turns = np.diff(angle, axis=0)[1:][free[1:]]
    due = 0.5 * simulation.scenario.task.step**0.5
    assert turns.std() == pytest.approx(due, rel=0.15)
    assert np.abs(turns.mean()) < 0.2 * due


def test_flee_goes_away_from_the_nearest_robot():
    # Story: away from walls, the velocity in a step is opposite to where the nearest robot was.
    towards, free = towards_nearest(*played("flee", 30))
    assert free.sum() > 20
    assert towards[free] == pytest.approx(-1.0, abs=1e-3)


def test_shadow_stays_just_outside_the_nearest_disc():
    # Story: robots do not move; every rogue goes straight to 5 % outside the nearest disc, and stays there.
    simulation, rows = played("shadow", 120, policy="still")
    present, gap = entries(simulation, rows[-20:], "present", "robot_0_gap")
    assert present.mean() > 0.6  # the cars coast at first
    assert gap[present == 1] == pytest.approx(0.05, abs=0.01)
    towards, free = towards_nearest(simulation, rows)
    far = free & (entries(simulation, rows, "robot_0_gap")[0, :-1] > 1.0)
    assert far.sum() > 20
    assert towards[far] == pytest.approx(1.0, abs=0.03)


def test_follow_gap_widens_its_gap_to_standing_robots():
    # Story: once the cars are at rest, no undetected rogue comes nearer to a disc, and the gaps have grown.
    simulation, rows = played("follow-gap", 60, policy="still")
    present, gap = entries(simulation, rows, "present", "robot_0_gap")
    undetected = present[-1] == 1
    assert undetected.mean() > 0.8
    assert (gap[-1] >= gap[30] - 0.05)[undetected].all()
    assert gap[-1][undetected].mean() > gap[0][undetected].mean() + 0.5


@pytest.mark.parametrize(("name", "policy"), [("follow-gap", "kuramoto-mpcc"), ("agents", "sweep"), ("shadow", "laps")])
def test_no_rogue_outlasts_the_proved_bound(name, policy):
    # Law: the bound of `task.conservative` holds for scripts, and for agents with random linear policies.
    settings = BOUNDED | {"targets.arrival_rate": 1.0, "targets.count": 4, "sensing.radius": 0.5}
    scenario = lissajous_env.scenario("experiment", rogues=name, **SMALL | settings)
    simulation = Simulation(scenario, 4)
    driver = baselines.make(policy, scenario, 4)
    weights = np.random.default_rng(2).normal(size=(4, rogue_layout(scenario).size, 2))
    for _ in range(scenario.task.steps):
        action = np.einsum("wtd,wda->wta", simulation.rogues.observation.numpy(), weights)
        of_rogues = (np.clip(action, -1, 1),) if name == "agents" else ()
        simulation.step(driver.act(simulation.observation), *of_rogues)
    rows = simulation.score()
    assert max(row["detection_time_max"] for row in rows) > 1.0
    for row in rows:
        assert row["detection_time_max"] <= row["guaranteed_detection_time"] + 1e-6


def test_a_rule_of_ones_own_is_a_function_of_the_rows():
    # Story: it goes right, until the wall stops it; other rules are refused by name.
    @lissajous_env.rogue("rightwards")
    def rightwards(rows):
        """Go right."""
        return np.broadcast_to([1.0, 0.0], (*rows.shape[:2], 2))

    simulation, rows = played("rightwards", 10, policy="still")
    present, speed = entries(simulation, rows[1:], "present", "x_velocity")
    assert speed[present == 1] == pytest.approx(1.0, abs=1e-4)
    with pytest.raises(ValueError, match="name of a rogue must be new, got 'rightwards'"):
        lissajous_env.rogue("rightwards")(lambda rows: rows)
    with pytest.raises(ValueError, match="must be of small letters"):
        lissajous_env.rogue("Right wards")(rightwards)
    lissajous_env.rogue("misshapen")(lambda rows: rows)
    with pytest.raises(ValueError, match="rogue misshapen must return finite numbers of shape"):
        played("misshapen", 1)


def test_commands_name_a_script(capsys, tmp_path):
    # Story: the scores are those of the same scenario in Python; agents and unknown names are refused.
    short = ("--set", "task.duration=5")
    options = ("--rogues", "flee", "--json", "--out", tmp_path / "a.npz", *short)
    code, said, _ = called(capsys, "run", "evaders", "sweep", *options)
    assert code == 0
    scenario = lissajous_env.scenario("evaders", rogues="flee", **{"task.duration": 5.0})
    due = lissajous_env.evaluate(baselines.make("sweep", scenario), scenario, seeds=[0])[0]
    assert json.loads(said)["detection_time_mean"] == due["detection_time_mean"]
    code, _, said = called(capsys, "evaluate", "evaders", "sweep", "--rogues", "agents", *short)
    assert code == 2
    assert "targets.rogues of evaders must be None, or the name or the folder of a rogue" in said
