"""The contamination field: small stories, brute force, and evading targets that know the future."""

import numpy as np
import pytest
from reference_contamination import Field, sensors_of

import baselines
import lissajous_env
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.world.contamination.labels import introduced_at
from lissajous_env.world.state import NEVER

POINTS = {
    "robot.kind": "curve", "formation.start_noise": 0.0, "formation.ring": None, "faults.schedule": (),
    "noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0, "robot.model_offset": None,
}  # fmt: skip
ALWAYS = {"targets.count": 1, "targets.arrival_rate": 1.0, "task.grid": None}
HALF = 1.8, 0.8


def played(policy, seed=0, slices=0, **overrides):
    """An episode on `experiment`: the simulation, the age after each step [step], and the sensors in slices of it."""
    scenario = lissajous_env.scenario("experiment", **{"faults.schedule": (), **ALWAYS, **overrides})
    simulation = lissajous_env.Simulation(scenario, seed=seed)
    ages, sensors = [], []

    def keep(_):
        ages.append(int(simulation.contamination.age.numpy()[0]))
        if slices:
            sensors.append(sensors_of(simulation, slices))

    EpisodeRunner(baselines.make(policy, scenario, 1), simulation).play([seed], keep)
    return simulation, np.array(ages), np.array(sensors)


def standing(radius, grid, duration=20.0, **overrides):
    """Return a simulation of one point that rests in the middle of the upper edge of its curve."""
    scenario = lissajous_env.scenario(
        "experiment",
        **{**POINTS, **ALWAYS, "robot.count": 1, "formation.p": 0, "robot.phase_rate_max": 1e-9}
        | {"sensing.radius": radius, "task.contamination": grid, "task.duration": duration, **overrides},
    )
    return lissajous_env.Simulation(scenario)


def advance(simulation, steps):
    for _ in range(steps):
        simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))


@pytest.mark.parametrize("speed", [0.1, 0.9, 3.0])
def test_a_front_advances_at_the_rogues_speed_in_every_direction(speed):
    # Story: nobody is anywhere but in one cell in the middle; after some time rogues may be in the disc around it.
    columns = 121
    scenario = lissajous_env.scenario(
        "experiment",
        **{**POINTS, **ALWAYS, "targets.arrival_rate": 0.0, "task.duration": 100.0, "targets.speed_limit": speed},
        **{"targets.speed": min(speed, 0.02), "curve.half_width": 5.0, "curve.half_height": 5.0},
        **{"task.contamination": (columns, columns), "sensing.radius": 1e-5},
    )
    simulation = lissajous_env.Simulation(scenario)
    there = np.zeros_like(simulation.contamination.labelled.numpy())
    there[0, columns // 2 + 2, columns // 2 // 32 + 1] = 1 << columns // 2 % 32
    simulation.contamination.labelled.assign(there)
    time = 3.0 / speed
    advance(simulation, round(time / 0.1))
    nodes = np.linspace(-5, 5, columns)
    away = np.hypot(nodes, nodes[:, None])
    reached = introduced_at(simulation) < NEVER
    hop = np.sqrt(5) * 10 / (columns - 1)  # the first one is free: the rogue has been there for long
    assert reached[away < 3.0 / 1.028 - 0.3 * hop].all()
    assert not reached[away > 3.0 + hop].any()


def test_a_cell_that_a_disc_leaves_is_contaminated_from_its_edge():
    # Story: one disc, at rest, in a rectangle of rogues that were there from the start; it stays clear inside.
    simulation = standing(0.5, (90, 40))
    advance(simulation, 50)
    assert simulation.contamination.age.numpy()[0] == 50
    row = simulation.score()[0]
    assert row["guaranteed_detection_time"] == row["unseen_at_end"] == pytest.approx(5.0)
    cells = np.count_nonzero(introduced_at(simulation) == 0)
    place = simulation.robots.sensor.numpy()[0, 0]
    x, y = np.linspace(-1.8, 1.8, 90), np.linspace(-0.8, 0.8, 40)
    outside = np.hypot(x - place[0], y[:, None] - place[1]) > 0.5
    assert cells == np.count_nonzero(outside)
    # Every cell outside is as old as the episode: 5 s; on the mean over time half of that.
    assert row["contaminated_age_mean"] == pytest.approx(2.5 * outside.mean(), rel=0.03)


def test_where_rogues_enter():
    # Story: nobody at the start; rogues come in over the boundary alone, and walk inward.
    overrides = {"targets.count": 0, "targets.entry": "boundary", "targets.speed_limit": 0.2}
    simulation = standing(0.01, (90, 40), **overrides)
    assert (introduced_at(simulation) == NEVER).all()
    advance(simulation, 1)
    now = introduced_at(simulation)
    assert (now[[0, -1]] == 1).all()
    assert (now[:, [0, -1]] == 1).all()
    assert (now[2:-2, 2:-2] == NEVER).all()
    advance(simulation, 20)  # 0.4 m: ten cells
    assert introduced_at(simulation)[9, 45] < NEVER
    assert introduced_at(simulation)[12, 45] == NEVER
    simulation = standing(0.01, (90, 40), **overrides | {"targets.speed_limit": 4.0})  # 0.4 m in the step they enter
    advance(simulation, 1)
    assert (introduced_at(simulation)[[8, -9]] == 1).all()
    assert (introduced_at(simulation)[11:-11, 11:-11] == NEVER).all()


def test_without_rogues_there_is_nothing_to_guarantee():
    simulation = standing(0.5, (36, 16), **{"targets.count": 0, "targets.arrival_rate": 0.0})
    advance(simulation, 5)
    row = simulation.score()[0]
    assert (row["guaranteed_detection_time"], row["contaminated_age_mean"]) == (0.0, 0.0)
    assert np.isnan(standing(0.5, None).score()[0]["guaranteed_detection_time"])


def test_the_field_is_that_of_brute_force():
    policy, radius, speed = "kuramoto-mpcc", 0.75, 0.8
    setting = {"sensing.radius": radius, "targets.speed_limit": speed, "task.duration": 8.0}
    simulation, ages, sensors = played(policy, 3, slices=2, **setting, **{"task.contamination": (180, 80)})
    brute = Field(sensors, HALF, radius, speed, 0.1).run()
    assert abs(ages.max() - brute.max()) <= 2.0  # steps
    assert np.mean(np.abs(ages - brute) <= 1.0) > 0.9
    assert simulation.score()[0]["guaranteed_detection_time"] == pytest.approx(0.1 * ages.max())


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"task.contamination": (90, 10)}, "sides differ by 1.5 times at most"),
        ({"task.contamination": (90, 0)}, "each from 1 to 4096"),
        ({"task.contamination": (90,)}, "must be .columns, rows., each from 1 to 4096, or None"),
        ({"task.contamination": (900, 400), "targets.speed_limit": 9.0}, "of an evading target's motion in a step"),
        ({"targets.speed_limit": 0.1}, "at least the speed of these targets, 0.2 m/s"),
        ({"task.contamination": (90, 40), "targets.custom": 0.5, "targets.wandering": 0.5}, "must be given"),
    ],
)
def test_what_cannot_be_followed_is_refused_by_name(overrides, words):
    with pytest.raises(ValueError, match=words):
        lissajous_env.scenario("experiment", **overrides)
