"""The contouring controller against IPOPT, its cost in float64, closed forms, and physical stories."""

import dataclasses
import importlib
import math

import numpy as np
import pytest
import warp as wp

from baselines.mpcc.solver import Mpcc, MpccParameters
from lissajous_env.parameters.scenario import Curve, Robot, Scenario

CURVE = Curve()
P = MpccParameters()


def load_benchmark():
    """Import benchmarks/mpcc.py, which holds the problem once more in CasADi and the closed loop in NumPy."""
    return importlib.import_module("mpcc")


@pytest.fixture(scope="module")
def near():
    """Random states near the curve, with guesses."""
    return load_benchmark().random_problems(64, CURVE, P, np.random.default_rng(3))


def test_costs_no_more_than_ipopt():
    """Oracle: IPOPT on the same problem from the same guess, on states met in closed loop and on random ones."""
    benchmark = load_benchmark()
    ipopt = benchmark.Ipopt(CURVE, P)
    rng = np.random.default_rng(7)
    met, _ = benchmark.closed_loop(Mpcc(CURVE, P, 5), CURVE, 120)
    excess = []
    for problems in (met[rng.permutation(595)[:16]], benchmark.random_problems(16, CURVE, P, rng)):
        solution = Mpcc(CURVE, P, 16).solve(problems.state, problems.phase_rate, problems.guess)
        for k in range(16):
            state, phase_rate = problems.state[k], problems.phase_rate[k]
            cost = ipopt.cost(state, phase_rate, solution.control[k].astype(float))
            excess.append(cost / ipopt.solve(state, phase_rate, problems.guess[k])[0] - 1)
    assert np.median(excess) < 1e-3
    assert np.sum(np.array(excess) > 0.01) <= 1


@pytest.mark.parametrize(("stages", "step", "curve", "rtol"), [
    (15, 0.1, CURVE, 5e-4), (15, 0.1, Curve(5.0, 5.0, 7, 8), 5e-4), (1, 0.1, CURVE, 2e-3),
    (15, 0.3, Curve(5.0, 5.0, 7, 3), 2e-3),
])  # fmt: skip
def test_cost_and_trajectory_are_those_of_the_control(stages, step, curve, rtol):
    """Oracle: the rollout and (11a) in float64 by CasADi; float32 sums of 16 stages keep 1e-4."""
    p = dataclasses.replace(P, stages=stages, step=step)
    problems = load_benchmark().random_problems(16, curve, p, np.random.default_rng(5))
    solution, model = Mpcc(curve, p, 16).solve(problems.state, problems.phase_rate), load_benchmark().Model(curve, p)
    cost = [model.cost(problems.state[k], problems.phase_rate[k], solution.control[k]) for k in range(16)]
    np.testing.assert_allclose(solution.cost, cost, rtol=rtol)
    if step == P.step:
        path = [model.rollout(problems.state[k], solution.control[k]) for k in range(16)]
        # The fastest phase is a few rad per second where the curve is slow: float32 errors grow along the horizon.
        np.testing.assert_allclose(solution.trajectory, path, atol=1e-3)


def test_control_stays_in_its_bounds_and_reaches_them(near):
    """Oracle: constraint (11c)."""
    control = Mpcc(CURVE, P, 64).solve(near.state, near.phase_rate).control
    assert np.abs(control[..., 0]).max() == np.float32(P.steering_max)
    assert control[..., 1].min() == np.float32(P.throttle_min)
    assert control[..., 1].max() == np.float32(P.throttle_max)


def test_a_circle_is_driven_with_constant_steering_and_throttle():
    """Oracle: a bicycle on a circle steers atan(l / R) and holds its speed with tau = (c v + beta) / alpha."""
    circle, rate = Curve(half_width=1.0, half_height=1.0, a=1, b=1), 0.8
    state = np.array([[1.0, 0.0, math.pi / 2, rate, 0.0]])
    # Without the weights on the inputs, driving on the circle costs nothing.
    p = MpccParameters(weight_steering=1e-6, weight_throttle=1e-6, tolerance=1e-7)
    control = Mpcc(circle, p).solve(state, np.array([rate])).control[0]
    np.testing.assert_allclose(control[:10, 0], math.atan(p.wheelbase), atol=0.01)
    np.testing.assert_allclose(control[:10, 1], (p.drag * rate + p.offset) / p.drive, atol=1e-3)


def test_a_warm_start_is_the_last_solution_shifted(near):
    """Oracle: the same solve from that guess, given by hand; where the warm start does well both take the same way."""
    warm, cold = Mpcc(CURVE, P, 64), Mpcc(CURVE, P, 64)
    last = warm.solve(near.state, near.phase_rate)
    state = last.trajectory[:, 1]
    guess = np.concatenate([last.control[:, 1:], last.control[:, -1:]], axis=1)
    shifted = warm.solve(state, near.phase_rate)
    by_hand = cold.solve(state, near.phase_rate, guess)
    easy = by_hand.cost < P.poor * (P.stages + 1) * near.phase_rate**2
    assert easy.sum() > 20
    np.testing.assert_array_equal(shifted.control[easy], by_hand.control[easy])
    assert shifted.iterations.mean() < last.iterations.mean()


def test_reset_forgets_the_warm_start_of_the_chosen_ones(near):
    """Oracle: a solver that never solved before."""
    mpcc = Mpcc(CURVE, P, 64)
    first = mpcc.solve(near.state, near.phase_rate)
    mpcc.solve(near.state[::-1], near.phase_rate[::-1])
    chosen = np.arange(64) < 32
    mpcc.reset(chosen)
    again = mpcc.solve(near.state, near.phase_rate)
    np.testing.assert_array_equal(again.control[chosen], first.control[chosen])
    assert (again.iterations[~chosen] != first.iterations[~chosen]).any()


def test_a_problem_does_not_depend_on_its_batch(near):
    """Oracle: the batch law, bit for bit, cold and warm, over batch sizes, positions and thread counts."""
    batch, single = Mpcc(CURVE, P, 64, threads=1), Mpcc(CURVE, P, 1)
    double = Mpcc(CURVE, P, 128, threads=2)
    for _ in range(2):
        one = batch.solve(near.state, near.phase_rate)
        two = double.solve(np.tile(near.state, (2, 1)), np.tile(near.phase_rate, 2))
        alone = single.solve(near.state[37:38], near.phase_rate[37:38])
        for all_of, twice, of_one in zip(one, two, alone, strict=True):
            np.testing.assert_array_equal(twice, np.concatenate([all_of, all_of]))
            np.testing.assert_array_equal(all_of[37:38], of_one)


@pytest.mark.parametrize("value", [math.nan, 1e38])
def test_a_failed_solve_brakes_is_counted_and_starts_afresh(near, value):
    """Physical story: one car loses its position for a step; it brakes straight on, and the others do not notice.

    A phase rate that is no number fails, too, and a guess that is none is only a bad start.
    """
    mpcc, expected = Mpcc(CURVE, P, 64), Mpcc(CURVE, P, 64).solve(near.state, near.phase_rate)
    state = near.state.copy()
    state[5, 1] = value
    solution = mpcc.solve(state, near.phase_rate)
    assert (solution.cost > 1e38).tolist() == [k == 5 for k in range(64)]
    np.testing.assert_array_equal(solution.control[5], np.tile(np.float32([0, P.throttle_min]), (P.stages, 1)))
    assert all(np.isfinite(result).all() for result in solution)
    np.testing.assert_array_equal(np.delete(solution.control, 5, axis=0), np.delete(expected.control, 5, axis=0))
    recovered = mpcc.solve(near.state, near.phase_rate)
    np.testing.assert_array_equal(recovered.control[5], expected.control[5])
    phase_rate, guess = near.phase_rate.copy(), near.guess.copy()
    phase_rate[0] = guess[1] = math.nan
    solution = mpcc.solve(near.state, phase_rate, guess)
    assert (solution.cost > 1e38).tolist() == [True] + [False] * 63
    assert all(np.isfinite(result).all() for result in solution)


def test_arrays_of_the_device_come_back_without_a_copy(near):
    """Warp in, the solver's own Warp arrays out; `launch` alone does the same."""
    mpcc, expected = Mpcc(CURVE, P, 64), Mpcc(CURVE, P, 64).solve(near.state, near.phase_rate)
    solution = mpcc.solve(*(wp.array(rows, dtype=wp.float32) for rows in (near.state, near.phase_rate)))
    assert solution.control is mpcc.control
    np.testing.assert_array_equal(solution.control.numpy(), expected.control)
    mpcc.reset()
    mpcc.launch()
    np.testing.assert_array_equal(mpcc.control.numpy(), expected.control)


def test_parameters_of_a_robot():
    """The model's offset is the robot's own, or what the designer measured; it does not brake in the dead zone."""
    assert MpccParameters.of(Scenario(robot=Robot())).offset == 3.681
    p = MpccParameters.of(Scenario(robot=Robot(wheelbase=0.2, model_offset=3.804)), stages=7)
    assert (p.offset, p.wheelbase, p.stages) == (3.804, 0.2, 7)
    assert [MpccParameters.of(Scenario(), step=step).shift for step in (0.05, 0.1, 0.4)] == [1.0, 1.0, 0.25]
    for throttle, least in ((0.0, 0.1), (0.12, 0.12)):
        assert MpccParameters.of(Scenario(robot=Robot(throttle_min=throttle))).throttle_min == pytest.approx(least)


@pytest.mark.parametrize(("make", "message"), [
    (lambda: MpccParameters(throttle_min=0.3), "throttle_max must be above throttle_min, got 0.25"),
    (lambda: Mpcc(CURVE, P, 0), "batch must be a whole number of at least 1, got 0"),
    (lambda: Mpcc(CURVE, P, 2, threads=0), "threads must be a whole number of at least 1, got 0"),
    (lambda: Mpcc(CURVE, P, 2).solve(np.zeros((3, 5)), np.zeros(2)), r"state must have shape \(2, 5\)"),
    (lambda: Mpcc(CURVE, P, 2).reset(np.zeros(3, bool)), r"mask must have shape \(2,\), got \(3,\)"),
    (lambda: Mpcc(CURVE, P, 2).restrict(2), "problem must be a whole number from 0 to 1, got 2"),
])  # fmt: skip
def test_what_is_wrong_is_named(make, message):
    """Errors say the name, the rule and the value."""
    with pytest.raises(ValueError, match=message):
        make()
