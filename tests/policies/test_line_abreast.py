"""The policy `line-abreast`: its spacing law, path, guarantee and ways into the lines."""

import math

import numpy as np
import pytest

import lissajous_env
from baselines.policies.line_abreast import LineAbreast, line_tables
from baselines.policies.line_path import (
    LineParameters,
    best_lines,
    failed_condition,
    ideal_worst_case,
    lanes_of,
    lines_of,
    speed_limit,
    turn_of,
)

INTRUDERS = lissajous_env.scenario("intruders", **{"task.contamination": (108, 48), "targets.speed_limit": 0.6})


def escapes(spacing, radius, rogue, speed, step, wall):
    """Return whether a rogue passes a line unsensed: all its ways at once, on a fine grid in the frame of the line.

    Two discs at y = -+ s / 2 move to the right; with a wall, one disc at y = -s / 2 and rogues below y = 0. At each
    observation the rogues in a disc are lost; between two they move by u dt anywhere, and the line by v dt.
    """
    cell = speed * step / 48
    x = np.arange(-round(1.2 * radius / cell), round(1.2 * radius / cell) + 1) * cell
    y = np.arange(-round(0.6 * radius / cell), 1 if wall else round(0.6 * radius / cell) + 1) * cell
    centres = [-spacing / 2] if wall else [-spacing / 2, spacing / 2]
    sensed = np.any([x**2 + (y[:, None] - centre) ** 2 <= radius**2 for centre in centres], axis=0)
    ahead = np.broadcast_to(x > radius * 0.6, sensed.shape)
    reach = int(rogue * step / cell)
    free = ahead & ~sensed
    for _ in range(math.ceil(3 * radius / ((speed - rogue) * step))):
        shifted = np.zeros_like(free)
        shifted[:, :-48] = free[:, 48:]
        shifted[:, -48:] = True  # there are always more rogues ahead
        moved = shifted.copy()
        for j in range(-reach, reach + 1):
            width = int(math.sqrt(reach**2 - j**2))
            rows = np.zeros_like(shifted)
            rows[max(j, 0) : len(y) + min(j, 0)] = shifted[max(-j, 0) : len(y) - max(j, 0)]
            counts = np.cumsum(np.pad(rows, ((0, 0), (width + 1, width))), axis=1)
            moved |= counts[:, 2 * width + 1 :] > counts[:, : -2 * width - 1]
        free = moved & ~sensed
    return bool(free[:, x < -0.6 * radius].any())


@pytest.mark.parametrize(
    ("spacing", "radius", "rogue", "step", "wall"), [(0.96, 0.5, 0.6, 0.1, False), (1.1, 0.6, 0.3, 0.2, True)]
)
def test_no_rogue_passes_below_the_speed_limit(spacing, radius, rogue, step, wall):
    """Oracle: brute force, 4 % below and above the limit."""
    limit = speed_limit(spacing, radius, rogue, step)
    assert not escapes(spacing, radius, rogue, 0.96 * limit, step, wall)
    assert escapes(spacing, radius, rogue, 1.04 * limit, step, wall)


@pytest.mark.parametrize("curvature", [0.1, 0.4])
def test_a_turn_comes_back_into_its_lane(curvature):
    """Oracle: the path of unit steps along the headings, integrated finely; equal arcs would take 7 pi / 3."""
    turn = turn_of(curvature)
    rates = np.diff(np.append(0.0, turn))
    fine = np.repeat(rates / 1000, 1000)
    heading = np.cumsum(fine) - fine / 2
    end = np.array([np.cos(heading).sum(), np.sin(heading).sum()]) / 1000
    np.testing.assert_allclose(end, 0, atol=1e-5)
    assert turn[-1] == pytest.approx(-math.pi)
    assert np.abs(rates).max() <= curvature
    assert len(turn) <= 1.15 * 7 * math.pi / 3 / curvature + 1


def test_cars_can_drive_the_turns_of_a_short_sweep():
    """Oracle: their tightest circle. A sweep of two whole steps is slower than the cars, which turn less in a step."""
    small = {"curve.half_width": 0.25, "curve.half_height": 0.2, "robot.radius": 0.01, "robot.wheelbase": 0.05}
    small |= {"robot.lateral_acceleration_max": 100.0, "task.step": 0.25, "sensing.radius": 0.3}
    scenario = lissajous_env.scenario("intruders", **small).resolve()
    (plan,), _ = lines_of(scenario, LineParameters(speed=2.0), 1)
    assert np.abs(np.diff(plan.path[:, 2])).max() <= plan.speed * scenario.task.step / scenario.turning_radius


def test_lines_share_the_span():
    """Oracle: every place across is sensed by each line, and cars of two lines pass clear of each other."""
    scenario = lissajous_env.scenario("intruders", **{"robot.count": 12}).resolve()
    assert [bool(lines_of(scenario, LineParameters(), count)[0]) for count in (1, 2, 3)] == [True, True, False]
    (plan,), _ = lines_of(scenario, LineParameters(), 2)
    across = np.linspace(-2.4, 2.4, 1001)
    for line in range(2):
        lanes = plan.lanes[plan.line_of == line]
        assert np.abs(across[:, None] - lanes).min(axis=1).max() < scenario.sensing_radius
    assert np.diff(np.sort(plan.lanes)).min() > 3 * scenario.robot.radius


@pytest.mark.parametrize(("overrides", "words"), [
    ({"sensing.radius": 0.3}, "5 cars to span 4.8 m with discs of 0.3 m: the cars of a line would be 0.96 m apart"),
    ({"targets.speed_limit": 4.0}, "5 cars to span 4.8 m with discs of 0.5 m: rogues of 4 m/s cross a line within"),
    ({"robot.count": 9, "lines": 2}, "2 lines of 9 cars .*: the cars of a line would be 1.2 m apart instead of"),
    ({"robot.count": 12, "lines": 2, "robot.radius": 0.2}, "pass each other at 0.436 m, and need 0.6 m"),
    ({"task.boundary": "wall"}, "half circles of 0.5.* m, so the outermost would be 1.2.* m from its wall"),
    ({"task.boundary": "wall", "robot.wheelbase": 2.7}, "turns of 8.06 m do not fit .* m inside of sides 4.8 m"),
    ({"robot.radius": 0.49}, "bodies 0.98 m"), ({"lines": 6}, "fewer cars than lines"),
    ({"robot.speed_max": 0.1, "noise.drive_spread": 0.1}, "slowest car"), ({"robot.count": 1}, "of 1 car .* outermost"),
    ({"task.boundary": "wall", "sensing.radius": 1.5}, "requires a start that .* robots know .* got rotated and 0.02"),
])  # fmt: skip
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_line_that_cannot_work_is_refused(overrides, words):
    lines = overrides.pop("lines", None)
    with pytest.raises(ValueError, match=words):
        LineAbreast(lissajous_env.scenario("intruders", **overrides), parameters=LineParameters(lines=lines))


def test_rogues_pass_lines_that_turn_inside_only_above_the_speed_limit():
    """Oracle: the spacing law, solved for the speed of rogues."""
    walls = {"task.boundary": "wall", "sensing.radius": 1.5}
    scenario = lissajous_env.scenario("intruders", **walls).resolve()
    plan = lines_of(scenario, LineParameters(), 1)[0][0]
    spacing = lanes_of(scenario, 1, plan.aside)[1]
    for share, words in ((0.9, "cross a line within a step"), (1.1, "")):
        rogues = speed_limit(spacing, 1.5, share * plan.speed, scenario.task.step)
        faster = lissajous_env.scenario("intruders", **walls, **{"targets.speed_limit": rogues}).resolve()
        assert words in failed_condition(faster, 1, plan.speed, plan.aside)
        assert bool(words) == bool(failed_condition(faster, 1, plan.speed, plan.aside))


def test_lines_far_from_the_end_of_the_rectangle_leave_places_unsensed():
    """Oracle: by hand, from half circles of 0.2 m that end 1.2 m from the wall, 3.2 m apart: hypot(1.4, 1.6) - 0.2."""
    far = lissajous_env.scenario("intruders", **{"curve.inset": 1.2, "sensing.radius": 1.7}).resolve()
    assert "end of the rectangle would be 1.93 m from sensors of 1.7 m" in failed_condition(far, 1, 1.0, 0.2)


def test_all_starts_have_the_same_guarantee_and_no_cars_collide():
    """Oracle: the contamination of the simulated world, with exact discs on a grid, and its count of collisions."""
    scenario = lissajous_env.scenario(INTRUDERS, **{"task.duration": 40.0})
    rows = lissajous_env.evaluate(LineAbreast(scenario, 4), scenario, seeds=range(4))
    worst = [row["guaranteed_detection_time"] for row in rows]
    assert max(worst) <= 18
    np.testing.assert_allclose(worst, np.mean(worst), rtol=0.03)
    assert sum(row["collisions"] for row in rows) == 0
    displaced = lissajous_env.scenario(scenario, **{"formation.displaced": ((2, 0.3),)})
    policy = LineAbreast(displaced, 8)
    policy.act(lissajous_env.Simulation(displaced, 8).observation)
    assert np.ptp(policy.variant.numpy(), axis=1).max() <= 1, "a team takes the ways of one angle"


UNEVEN = {"noise.wheelbase_spread": 0.02, "noise.drive_spread": 0.02, "formation.start": "equilibrium"}
LITTLE_GRIP = {"robot.lateral_acceleration_max": 0.9, "formation.phase_rate": 0.1, "sensing.radius": 1.0}


@pytest.mark.parametrize(("fields", "speed"), [(UNEVEN, None), ({}, 1.4), (LITTLE_GRIP, None)])
def test_cars_form_the_line_and_keep_it(fields, speed):
    """Oracle: the places of the tables, from the moment on at which the lines are to have formed."""
    scenario = lissajous_env.scenario("intruders", **fields)
    policy = LineAbreast(scenario, 32, parameters=LineParameters(speed=speed))
    simulation, missed = lissajous_env.Simulation(scenario, 32, seed=2), []
    for step in range(policy.tables.lead_in_steps + 100):
        simulation.step(policy.act(simulation.observation))
        places = policy.tables.places(step + 1)[:, :, -1]
        missed.append(simulation.robots.position.numpy()[..., :2] - places[policy.variant.numpy(), np.arange(5)])
    assert np.linalg.norm(missed[policy.tables.lead_in_steps :], axis=-1).max() < 0.03


def test_more_lines_guarantee_more():
    """Oracle: half of the period less the time of a turn, at which two lines meet again."""
    scenario = lissajous_env.scenario("intruders", **{"robot.count": 12}).resolve()
    one, two = (lines_of(scenario, LineParameters(), count)[0][0] for count in (1, 2))
    assert ideal_worst_case(scenario, two) == pytest.approx(0.5 * len(two.path) * scenario.task.step, rel=0.1)
    assert ideal_worst_case(scenario, two) < 0.7 * ideal_worst_case(scenario, one)
    assert best_lines(scenario, LineParameters()).line_of.max() == 1


def test_lines_stand_upright_in_an_upright_rectangle():
    """Oracle: the same rectangle on its side, turned by a quarter."""
    turned, known = {"curve.half_width": 2.4, "curve.half_height": 5.4}, {"formation.start": "equilibrium"}
    scenarios = (lissajous_env.scenario("intruders", **known, **sides).resolve() for sides in ({}, turned))
    lying, upright = (line_tables(scenario, LineParameters(speed=1.5)) for scenario in scenarios)
    np.testing.assert_array_equal(lying[0].lanes, upright[0].lanes)
    begin = [tables.pose[0, :, 4 * tables.lead_in_steps :: 4, :2] for _, tables, *_ in (lying, upright)]
    np.testing.assert_allclose(begin[1], np.stack([-begin[0][..., 1], begin[0][..., 0]], axis=-1), atol=1e-6)


def test_lines_that_turn_inside_keep_their_spacing_and_stay_off_the_walls():
    """Law over random halls: no car leaves the driven rectangle, turns too tightly or leaves a gap beside it."""
    draw, played = np.random.default_rng(5), 0
    for _ in range(30):
        height = math.exp(draw.uniform(math.log(2), math.log(50)))
        halves = {"curve.half_width": height / 2 * draw.uniform(1, 5), "curve.half_height": height / 2}
        cars = {"robot.count": int(draw.integers(2, 12)), "robot.radius": height * draw.uniform(0.005, 0.03)}
        cars["robot.wheelbase"] = height * draw.uniform(0.005, 0.05)
        cars["sensing.radius"] = height * draw.uniform(0.1, 0.5)
        scenario = lissajous_env.scenario("intruders", **{"task.boundary": "wall"}, **halves, **cars).resolve()
        for lines in (1, 2):
            for plan in lines_of(scenario, LineParameters(), lines)[0]:
                played += 1
                path = plan.path
                y = path[:, 1, None] + plan.lanes
                assert np.abs(path[:, 0]).max() <= scenario.driven.half_width * (1 + 1e-9)
                assert np.abs(y).max() <= scenario.driven.half_height * (1 + 1e-9)
                turn = np.abs(np.angle(np.exp(1j * np.diff(path[:, 2], append=path[0, 2])))).max() / scenario.task.step
                assert turn <= plan.speed / scenario.turning_radius
                for line in range(lines):
                    across = np.sort(y[:, plan.line_of == line], axis=1)
                    widest = np.diff(across, axis=1).max(initial=0.0)
                    beside = max(height / 2 - across.max(axis=1).min(), across.min(axis=1).max() + height / 2)
                    spacing = max(widest, 2 * beside) * (1 - 1e-6)
                    rogues = scenario.sensing_radius, scenario.rogue_speed, scenario.task.step
                    assert plan.speed <= speed_limit(spacing, *rogues)
                across = np.unique(path[:, 1].round(9))  # cars of other lines meet at any two places of the path
                other = across[:, None] - across + (plan.lanes[1:] - plan.lanes[0])[:, None, None]
                assert lines == 1 or np.abs(other).min() > 2 * scenario.robot.radius
    assert played >= 15


@pytest.mark.parametrize(("name", "most"), [("team", 0.5), ("evaders-failure", 0.75)])
def test_cars_off_their_places_avoid_others(name, most):
    scenario = lissajous_env.scenario(name, **{"task.contamination": None})
    rows = lissajous_env.evaluate(LineAbreast(scenario, 16), scenario, range(500, 516))
    assert np.mean([row["collisions"] for row in rows]) < most  # without the filter 2.9 and 1.0
