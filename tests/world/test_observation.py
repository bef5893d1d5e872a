"""Observations: the documented layout, messages, noise, and lists of neighbours."""

import math
import re

import numpy as np
import pytest
import reference_motion

import lissajous_env
from lissajous_env.world import observation

OWN, LINK = 8, 6
QUIET = {
    "targets.count": 0, "targets.arrival_rate": 0.0, "task.grid": None, "formation.start_noise": 0.0,
    "faults.schedule": (),
}  # fmt: skip


def rows_of(simulation):
    return simulation.observation.numpy().copy()


def entry(simulation, name):
    return simulation.layout.names.index(name)


def step(simulation, value=0.3):
    simulation.step(np.full(simulation.action_shape, value, dtype=np.float32))


@pytest.mark.parametrize(("robots", "targets"), [(2, 4), (0, 5)])
def test_the_layout_is_the_one_that_is_promised(robots, targets):
    # Oracle: places, names and ranges written down by hand.
    scenario = lissajous_env.scenario("failure", **{"sensing.robots_seen": robots, "sensing.targets_seen": targets})
    layout = observation.layout(scenario)
    assert {len(column) for column in layout} == {layout.size} == {20 + 5 * robots + 3 * targets}
    assert len(set(layout.names)) == layout.size
    promised = {
        0: ("x", 4), 1: ("y", 4), 2: ("cos_heading", 1), 3: ("sin_heading", 1), 4: ("speed", 4), 5: ("cos_phase", 1),
        6: ("sin_phase", 1), 7: ("works", 0), 8: ("neighbour_0_heard", 0), 14: ("neighbour_1_heard", 0),
        15: ("neighbour_1_age", 0), 16: ("neighbour_1_cos_phase", 1), 17: ("neighbour_1_sin_phase", 1),
        18: ("neighbour_1_x", 4), 19: ("neighbour_1_y", 4),
    }  # fmt: skip
    for k in range(robots):
        first = 20 + 5 * k
        promised |= {first: (f"robot_{k}_present", 0), first + 1: (f"robot_{k}_x", 1), first + 2: (f"robot_{k}_y", 1)}
        promised |= {first + 3: (f"robot_{k}_x_velocity", 1), first + 4: (f"robot_{k}_y_velocity", 1)}
    for k in range(targets):
        first = 20 + 5 * robots + 3 * k
        promised |= {
            first: (f"target_{k}_present", 0),
            first + 1: (f"target_{k}_x", 1),
            first + 2: (f"target_{k}_y", 1),
        }
    for place, (name, most) in promised.items():
        ranges = (layout.low[place], layout.high[place])
        assert (layout.names[place], *ranges) == (name, -most, max(most, 1)), "0 is for a range from 0 to 1"


def test_every_entry_says_what_it_is_and_in_which_unit():
    # Story: a reader asks what entry 21 is.
    scenario = lissajous_env.scenario("experiment")
    lines = str(observation.layout(scenario)).splitlines()
    assert lines[21].split(maxsplit=4) == [
        "21", "robot_0_x", "[-1,", "1]", "relative x [sight]",
    ]  # fmt: skip
    assert len(lines) == observation.layout(scenario).size
    assert all(re.search(r"\] +\S", line) for line in lines)


def test_lost_messages_are_lost_at_their_rate_and_age():
    # Oracle: binomial; ages of a geometric distribution, capped at 1 s; what was heard last stays.
    scenario = lissajous_env.scenario("failure", **QUIET, **{"noise.message_loss": 0.3})
    simulation = lissajous_env.Simulation(scenario, 400)
    ages = [entry(simulation, f"neighbour_{k}_age") for k in range(2)]
    heard = [entry(simulation, f"neighbour_{k}_heard") for k in range(2)]
    never, history = 1 - rows_of(simulation)[..., heard], []
    assert never.mean() == pytest.approx(0.3, abs=4 * math.sqrt(0.21 / never.size))
    for _ in range(60):
        step(simulation)
        history.append(rows_of(simulation)[..., ages])
    history = np.array(history)
    lost = history[20:] > 0
    deviation = 4 * math.sqrt(0.21 / lost.size)
    assert lost.mean() == pytest.approx(0.3, abs=deviation)
    twice = history[20:] > 0.15
    assert twice.mean() == pytest.approx(0.09, abs=deviation)
    assert (lost[1:] & lost[:-1]).mean() == pytest.approx(0.09, abs=deviation)
    assert abs(np.corrcoef(lost[..., 0].ravel(), lost[..., 1].ravel())[0, 1]) < 0.02


@pytest.mark.parametrize("field", ["position", "heading", "speed"])
def test_measurements_have_the_noise_that_was_asked_for(field):
    # Oracle: mean and deviation of independent normal draws; the truth is not touched.
    spread = 0.02
    scenario = lissajous_env.scenario("experiment", **{**QUIET, f"noise.{field}": spread})
    simulation = lissajous_env.Simulation(scenario, 300)
    exact = lissajous_env.Simulation(lissajous_env.scenario("experiment", **QUIET), 300)
    errors = []
    for _ in range(10):
        step(simulation)
        step(exact)
        robots = simulation.robots
        np.testing.assert_array_equal(robots.position.numpy(), exact.robots.position.numpy())
        np.testing.assert_array_equal(robots.phase.numpy(), exact.robots.phase.numpy())
        truth = np.dstack([robots.position.numpy()[..., :2], robots.heading.numpy(), robots.speed.numpy()])
        errors.append(robots.measured.numpy() - truth)
    errors = np.array(errors)
    noisy = {"position": [0, 1], "heading": [2], "speed": [3]}[field]
    assert (errors[..., [k for k in range(4) if k not in noisy]] == 0).all()
    drawn = errors[..., noisy]
    assert abs(drawn.mean()) < 4 * spread / math.sqrt(drawn.size)
    assert drawn.std() == pytest.approx(spread, rel=0.02)
    assert (drawn**4).mean() / drawn.var() ** 2 == pytest.approx(3, abs=0.25)
    assert abs(np.corrcoef(drawn[3].ravel(), drawn[4].ravel())[0, 1]) < 0.07
    assert abs(np.corrcoef(drawn[:, :, 0].ravel(), drawn[:, :, 1].ravel())[0, 1]) < 0.07


@pytest.mark.parametrize("alpha", [1, 3])
def test_the_measured_phase_is_that_of_the_measured_place(alpha):
    # Oracle: one projection of the noisy place onto the curve from the true parameter, in float64, and Lemma 2.
    overrides = {**QUIET, "noise.position": 0.02, "formation.alpha": alpha}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure", **overrides), 20)
    step(simulation)
    robots, curve = simulation.robots, simulation.scenario.curve
    truth, measured = robots.phase.numpy(), robots.measured.numpy()[..., :2].astype(float)
    expected = [
        [
            phase + reference_motion.projection(curve, place, alpha * phase) / alpha
            for phase, place in zip(*world, strict=True)
        ]
        for world in zip(truth, measured, strict=True)
    ]
    got = robots.measured_turn.numpy()[..., :2] @ [1, 1j]
    np.testing.assert_allclose(got, np.exp(1j * np.array(expected)), atol=2e-5)
    assert np.abs(got - np.exp(1j * truth)).max() > 1e-3


def test_actuator_noise_is_added_to_the_action():
    # Oracle: mean and deviation of the rate with which the phase continued, in units of the action.
    scenario = lissajous_env.scenario("failure", **QUIET, **{"noise.actuator": 0.1})
    simulation = lissajous_env.Simulation(scenario, 500)
    drawn = []
    for _ in range(10):
        before = simulation.robots.phase.numpy().copy()
        step(simulation, 0.2)
        moved = np.angle(np.exp(1j * (simulation.robots.phase.numpy() - before)))
        drawn.append(moved / 0.1 / simulation.scenario.robot.phase_rate_max - 0.2)
    drawn = np.array(drawn)
    assert abs(drawn.mean()) < 4 * 0.1 / math.sqrt(drawn.size)
    assert drawn.std() == pytest.approx(0.1, rel=0.02)
    # However large an action, the noise is there: it is added to what was clipped.
    before = simulation.robots.phase.numpy().copy()
    step(simulation, 100.0)
    moved = np.angle(np.exp(1j * (simulation.robots.phase.numpy() - before)))
    assert (moved / 0.1 / simulation.scenario.robot.phase_rate_max < 0.99).mean() == pytest.approx(0.46, abs=0.05)
