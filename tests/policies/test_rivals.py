"""Coordinators and trackers: their combinations, competing methods, and variants of the paper's method."""

import math
from functools import partial

import numpy as np
import pytest
import warp as wp
from scipy.integrate import quad
from scipy.optimize import brentq

import baselines
import lissajous_env
from baselines.policies import registry
from baselines.policies.coordinators import (
    PREVIEW,
    Consensus,
    KuramotoByArc,
    ReferenceParameters,
    TrackedReference,
    ground_speed,
)
from baselines.policies.loops import cruising_speed
from baselines.policies.trackers import Field, FieldParameters, OnCurve, field_of, field_rate, field_velocity
from baselines.similarity import motion_scale
from lissajous_env.device.devices import compile_quietly
from lissajous_env.episodes.evaluation import episodes
from lissajous_env.theory import closed_forms
from lissajous_env.theory.geometry import curve_length
from lissajous_env.world.observation import layout

POINTS = ("kuramoto", "open-loop", "tracked-reference", "running-reference", "consensus", "arc")
CARS = tuple(name + suffix for suffix in ("-mpcc", "-gvf") for name in POINTS)
NO_FAULTS = {"faults.schedule": ()}
BARE = {"targets.count": 0, "targets.arrival_rate": 0.0, "task.grid": None}


def played(name, base, worlds=8, **overrides):
    """Score rows of seeds 0, 1 ..., and the trace of the phase error (T, W) [rad]."""
    scenario = lissajous_env.scenario(base, **overrides)
    policy, errors = baselines.make(name, scenario, num_worlds=worlds), []
    batches = episodes(
        policy, scenario, range(worlds), on_step=lambda sim: errors.append(sim.tally.phase_error.numpy() * 1)
    )
    return [row for rows in batches for row in rows], np.array(errors)


def scores(policy, base, worlds=6, **overrides):
    """Score rows of seeds 0, 1 ... without targets; the policy is a name, or a factory."""
    scenario = lissajous_env.scenario(base, **BARE | overrides)
    acting = baselines.make(policy, scenario, worlds) if isinstance(policy, str) else policy(scenario, worlds, "cpu")
    return lissajous_env.evaluate(acting, scenario, range(worlds))


def mean(rows, column):
    return np.mean([row[column] for row in rows])


def device(array, dtype=wp.float32):
    return wp.array(np.asarray(array, dtype=np.float32), dtype=dtype, device="cpu")


# Every coordinator over every tracker: each name plays, and is what it says.


def test_the_names_are_the_cross_product():
    """Oracle: the documented names; cars with the collision filter under them too."""
    assert baselines.names("failure")[:6] == POINTS
    names = baselines.names("experiment")
    assert set(names[:12]) == set(CARS)
    assert {name + suffix for name in CARS for suffix in ("-safe", "-proved")} <= set(names)
    assert not set(CARS) & set(baselines.names("failure"))
    assert len({registry.describe(name)["description"] for name in (*POINTS, *CARS)}) == 18


def test_a_benchmark_plays_one_tracker_by_itself():
    """Oracle: the rule. Coordinators are compared over MPCC; the whole of Yao et al. is there, the rest on request."""
    usual = [name for name in baselines.names("experiment") if registry.is_default_on(name, "experiment")]
    on_request = {name for name in CARS if name.endswith("-gvf")} - {"consensus-gvf"}
    assert set(CARS) - set(usual) == on_request
    assert not any(name.removesuffix("-safe") in on_request for name in usual)
    assert all(registry.is_default_on(name, "failure") for name in POINTS)


@pytest.mark.parametrize(("name", "recovery"), [
    ("kuramoto", 2.0), ("consensus", 1.4), ("open-loop", math.nan), ("tracked-reference", math.nan),
])  # fmt: skip
def test_recovery_of_points(name, recovery):
    """Oracle: figures computed independently; who does not react, or stops with its robot, does not recover."""
    times = [row["recovery_time"] for row in scores(name, "failure")]
    assert times == pytest.approx([recovery] * 6, nan_ok=True)


def test_a_reference_that_runs_on_is_caught_up_with():
    """Oracle: 3.6 s where a robot may run at 7 omega, through the others; the law by hand for a slower one."""
    eager = partial(OnCurve, partial(TrackedReference, parameters=ReferenceParameters(runs_on=True, catch_up=6.0)))
    fast = scores(eager, "failure", **{"robot.phase_rate_max": 7 * 0.3})
    assert [row["recovery_time"] for row in fast] == pytest.approx([3.6] * 6)
    assert mean(fast, "collisions") > 5 * mean(scores("kuramoto", "failure"), "collisions")
    # The gap of 9.9 s closes at 1.5 omega down to 1.5 omega / k, then as exp(-k t); three of five robots are ahead of
    # the mean, so that the deviation is 0.05 rad where the gap of the other two is 0.05 / 0.6.
    gap, fastest = 0.3 * 9.9, 1.5 * 0.3
    expected = (gap - fastest) / fastest + math.log(fastest / (0.05 / 0.6))
    slower = scores("running-reference", "failure")
    assert [row["recovery_time"] for row in slower] == pytest.approx([expected] * 6, abs=0.15)


def test_the_coordinator_and_the_tracker_of_cars_are_distinguished():
    """Oracle: figures computed independently. Without a fault the tracker makes the collisions, after one both."""
    names = ("consensus-mpcc", "kuramoto-gvf")
    collisions = [mean(scores(name, "experiment", **NO_FAULTS), "collisions") for name in names]
    assert collisions == [pytest.approx(1.06, abs=1.5), pytest.approx(22.06, abs=6.0)]
    kuramoto, consensus = (scores(f"{name}-mpcc", "experiment", 24) for name in ("kuramoto", "consensus"))
    assert mean(consensus, "collisions") > 1.3 * mean(kuramoto, "collisions")


# What every policy promises.


@pytest.mark.parametrize(("name", "scenario"), [
    ("sweep", "intruders"), ("tracked-reference", "failure"), ("tracked-reference-mpcc", "rough"),
    ("consensus-gvf", "rough"),
])  # fmt: skip
def test_reset_forgets_one_world_alone(name, scenario):
    """Oracle: a policy made anew, for the world that was reset; its own continuation, for the other."""
    noisy = lissajous_env.scenario(scenario, **{"noise.actuator": 0.2})  # else points are where their references are
    simulation = lissajous_env.Simulation(noisy, num_worlds=2, seed=3)
    policy, untouched = (baselines.make(name, noisy, num_worlds=2) for _ in range(2))
    for _ in range(30):
        seen = simulation.observation.numpy().copy()
        simulation.step(policy.act(seen))
        untouched.act(seen)
    seen = simulation.observation.numpy().copy()
    policy.reset([1])
    action, expected = policy.act(seen), untouched.act(seen)
    np.testing.assert_array_equal(action[0], expected[0])
    np.testing.assert_array_equal(action[1], baselines.make(name, noisy, num_worlds=2).act(seen)[1])
    assert not np.array_equal(action[1], expected[1])


def test_the_curve_is_followed():
    """Oracle: the tracking error of `open-loop-mpcc`, times 1.5."""
    other, _ = played("open-loop-mpcc", "experiment", 6, **NO_FAULTS)
    for name in ("tracked-reference-mpcc", "consensus-gvf"):
        rows, _ = played(name, "experiment", 6, **NO_FAULTS)
        assert mean(rows, "tracking_error_mean") < 1.5 * mean(other, "tracking_error_mean")
        assert mean(rows, "phase_error") < 0.5 * mean(other, "phase_error")


# Yao et al. [16].


@pytest.mark.parametrize("overrides", [{"curve.a": 1, "curve.b": 4}, {"formation.p": 1}])
def test_consensus_is_linear_in_the_deviations(overrides):
    """Oracle: the formula in float64 on the true phases, with Delta from equilibrium (2) itself."""
    overrides = {"formation.start_noise": 0.5, "formation.coupling": 0.7, **overrides}
    scenario = lissajous_env.scenario("experiment", **overrides).resolve()
    simulation = lissajous_env.Simulation(scenario, num_worlds=8, seed=3)
    coordinator = Consensus(scenario, 8, "cpu")
    with compile_quietly():
        coordinator.coordinate(simulation.observation)
    off = simulation.robots.phase.numpy() - scenario.equilibrium
    rates = np.empty_like(off)
    for robot, pair in enumerate(scenario.neighbours):
        deviation = np.angle(np.exp(1j * (off[:, pair] - off[:, [robot]])))
        rates[:, robot] = 0.3 / scenario.alpha + 0.7 * deviation.sum(axis=1)
    np.testing.assert_allclose(coordinator.phase_rate.numpy(), rates, atol=1e-5)


@wp.kernel
def evaluate_field(
    field: Field, tangent: wp.array(dtype=wp.vec2), off: wp.array(dtype=wp.vec2), out: wp.array(dtype=wp.vec3)
):
    k = wp.tid()
    velocity = field_velocity(field, tangent[k], off[k])
    out[k] = wp.vec3(velocity[0], velocity[1], field_rate(field, tangent[k], off[k]))


def test_the_field_leads_to_the_path_and_vanishes_nowhere():
    """Oracle: d|off|^2/dt = -2 k V (|off|^2 + (off . f')^2), by hand; on the path q' = omega r' and gamma' = omega."""
    scenario = lissajous_env.scenario("experiment").resolve()
    field, draw = field_of(scenario, FieldParameters.of(scenario)), np.random.default_rng(0)
    tangent, off = 4 * draw.standard_normal((1000, 2)), draw.standard_normal((1000, 2))
    off[:100] = 0
    # Where the plane part vanishes, k off = f', the parameter still continues.
    off[100:200] = tangent[100:200] / (field.scale * field.pull)
    out = wp.zeros(1000, dtype=wp.vec3, device="cpu")
    with compile_quietly():
        inputs = [field, device(tangent, wp.vec2), device(off, wp.vec2), out]
        wp.launch(evaluate_field, 1000, inputs, device="cpu")
    velocity, rate = out.numpy()[:, :2].astype(float), out.numpy()[:, 2].astype(float)
    np.testing.assert_allclose(velocity[:100], 0.3 * tangent[:100], rtol=1e-5)
    np.testing.assert_allclose(rate[:100], 0.3, rtol=1e-5)
    assert (rate[100:200] > 0.3).all()
    assert np.linalg.norm(np.column_stack([velocity, rate * field.scale]), axis=1).min() > 0.1
    approach = 2 * np.sum(off * (velocity - tangent * rate[:, None]), axis=1)
    V, along = 0.3 * field.scale, np.sum(off * tangent, axis=1) / field.scale
    expected = -2 * field.pull * V * (np.sum(off**2, axis=1) + along**2)
    np.testing.assert_allclose(approach, expected, rtol=1e-3, atol=1e-4)


def test_consensus_keeps_a_spacing_that_kuramoto_cannot():
    """Oracle: Theorem 1, N / 4 < p < 3 N / 4; linear consensus is stable for any p that it is given."""
    unstable = {**NO_FAULTS, "formation.p": 1, "formation.alpha": 1}
    assert 1 not in closed_forms.stable_equilibria(5)
    assert played("consensus-gvf", "experiment", 2, **unstable)[1][-1].max() < 0.3
    assert played("kuramoto-mpcc", "experiment", 2, **unstable)[1][-1].min() > 0.5


# Arc length.


def arc_length(curve, gamma):
    """s(gamma) by adaptive quadrature [m]."""
    return quad(lambda g: closed_forms.curve_speed(curve, g), 0, gamma, limit=200)[0]


@pytest.mark.parametrize("overrides", [("intruders", 1, 4), ("knot", 3, 2)])
def test_dynamics_1_act_on_the_arc_phase(overrides):
    """Oracle: (1) in float64 on arc phases by quadrature of the true phases, with messages as old as is set."""
    name, a, b = overrides
    fields = {"formation.start": "random", "formation.coupling": 0.7, "curve.a": a, "curve.b": b}
    scenario = lissajous_env.scenario(name, **fields).resolve()
    alpha, curve = scenario.alpha, scenario.curve
    simulation, coordinator = lissajous_env.Simulation(scenario, seed=3), KuramotoByArc(scenario, 1, "cpu")
    rows = simulation.observation.numpy()
    rows[..., [layout(scenario).names.index(f"neighbour_{side}_age") for side in range(2)]] = 0.25
    with compile_quietly():
        coordinator.coordinate(simulation.observation)
    preview, unit = PREVIEW * motion_scale(scenario).time, arc_length(curve, 2 * math.pi) / (2 * math.pi)
    rate = ground_speed(scenario) / (unit * alpha)
    phases, rates = simulation.robots.phase.numpy()[0], coordinator.phase_rate.numpy()[0]
    psi = np.array([arc_length(curve, alpha * phase) for phase in phases]) / (unit * alpha)
    ahead = psi[scenario.neighbours] - psi[:, None] + rate * 0.25 * scenario.time_unit
    psi_rates = rate - 0.7 * np.sin(ahead).sum(axis=-1)
    for robot in range(scenario.num_robots):
        soon = alpha * (psi[robot] + preview * psi_rates[robot])
        gamma = brentq(lambda g, s=soon: arc_length(curve, g) / unit - s, soon - 2, soon + 2, xtol=1e-9)
        assert rates[robot] == pytest.approx((gamma / alpha - phases[robot]) / preview, abs=2e-4)


def test_ground_speed():
    """Oracle: the rule by hand: mean speed without a word on grip, a patrol's speed, the turn that grip allows."""
    length = curve_length(lissajous_env.scenario("experiment").curve)
    assert ground_speed(lissajous_env.scenario("experiment")) == pytest.approx(0.3 * length / (2 * math.pi))
    intruders = lissajous_env.scenario("intruders")
    assert ground_speed(intruders) == cruising_speed(intruders) == pytest.approx(1.7, abs=0.01)
    for grip, speed in ((2.0, math.sqrt(2.0 * 1.2)), (0.5, 0.118 * 3 * length / (2 * math.pi))):
        slippery = lissajous_env.scenario("intruders", **{"robot.lateral_acceleration_max": grip})
        assert ground_speed(slippery) == pytest.approx(speed)


# Clustered places (Lemmas 1 and 2), with the paper's coordination.


@pytest.mark.parametrize(("p", "alpha", "kappa"), [(7, None, 1), (7, 5, 5)])
def test_clustered_configurations(p, alpha, kappa):
    """Oracle: Lemma 1, kappa robots at each of N / kappa places, from near by too; (8) and T_max with that kappa."""
    chosen = {"formation.p": p, "formation.alpha": alpha, "targets.count": 200, "task.duration": 60.0}
    scenario = lissajous_env.scenario("ideal", **chosen)
    assert scenario.clusters == kappa
    assert scenario.detection_time_bound == pytest.approx(2 * math.pi / 0.05 * kappa / 15)
    assert scenario.detection_radius == pytest.approx(math.sin(math.pi * kappa / 15) * math.hypot(5, 5))
    exact, errors = played("kuramoto", scenario, 1)
    assert errors.max() < 1e-4
    assert exact[0]["spacing_factor"] == pytest.approx(1.0, abs=2e-3)
    assert exact[0]["detected_within_bound"] == 1.0
    nearby = lissajous_env.scenario(scenario, **{"formation.start_noise": 0.1, "task.duration": 120.0})
    simulation, policy = lissajous_env.Simulation(nearby, 4), baselines.make("kuramoto", nearby, num_worlds=4)
    assert simulation.tally.phase_error.numpy().min() > 0.05
    for _ in range(nearby.task.steps):
        simulation.step(policy.act(simulation.observation))
    assert simulation.tally.phase_error.numpy().max() < 0.005
    places = simulation.robots.position.numpy()
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
    assert ((apart < 0.2).sum(axis=-1) == kappa).all()


def test_random_starts_reach_the_stable_equilibria():
    """Oracle: Theorem 1; of 2,000 starts, simulated independently, 51 % reach p = 2 and the others p = 3."""
    fields = {"curve.a": 3, "curve.b": 2, "formation.p": None, "formation.start": "random", "task.duration": 60.0}
    scenario = lissajous_env.scenario("failure", **fields, **NO_FAULTS, **{"targets.count": 0, "task.grid": None})
    simulation, policy = lissajous_env.Simulation(scenario, 200), baselines.make("kuramoto", scenario, 200)
    for _ in range(scenario.task.steps):
        simulation.step(policy.act(simulation.observation))
    phases = simulation.robots.phase.numpy()
    gaps = (np.roll(phases, -1, axis=1) - phases) % (2 * math.pi)
    reached = np.round(gaps.sum(axis=1) / (2 * math.pi)).astype(int)
    assert set(reached) == set(closed_forms.stable_equilibria(5)) == {2, 3}
    assert np.abs(gaps - 2 * math.pi * reached[:, None] / 5).max() < 0.05
    assert np.mean(reached == 2) == pytest.approx(0.51, abs=0.14)
