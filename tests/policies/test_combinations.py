"""Every coordinator over every tracker: each name plays, and is what it says."""

import math
from functools import partial

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

import baselines
import lissajous_env
from baselines.policies import registry
from baselines.policies.coordinators import ReferenceParameters, TrackedReference
from baselines.policies.trackers import OnCurve

COORDINATORS = ("kuramoto", "open-loop", "tracked-reference", "running-reference", "consensus", "arc")
POINTS = COORDINATORS
CARS = tuple(name + suffix for suffix in ("-mpcc", "-gvf") for name in COORDINATORS)
BARE = {"targets.count": 0, "targets.arrival_rate": 0.0, "task.grid": None}
NO_FAULTS = {"faults.schedule": ()}
"""Of `failure` and `experiment`."""
SEEDS = range(6)


def played(policy, scenario, **overrides):
    """Score rows of some seeds; the policy is a name, or a factory."""
    made = lissajous_env.scenario(scenario, **BARE | overrides)
    acting = baselines.make(policy, made, len(SEEDS)) if isinstance(policy, str) else policy(made, len(SEEDS), "cpu")
    return lissajous_env.evaluate(acting, made, SEEDS)


def mean(rows, column):
    return np.mean([row[column] for row in rows])


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
    usual = [name for name in baselines.names("experiment") if registry.made_for(name, "experiment")]
    on_request = {name for name in CARS if name.endswith("-gvf")} - {"consensus-gvf"}
    assert set(CARS) - set(usual) == on_request
    assert not any(name.removesuffix("-safe") in on_request for name in usual)
    assert all(registry.made_for(name, "failure") for name in POINTS)


# Each is what its name says. Points: the failure of Fig. 6.


@pytest.mark.parametrize(("name", "recovery"), [
    ("kuramoto", 2.0), ("consensus", 1.4), ("open-loop", math.nan), ("tracked-reference", math.nan),
])  # fmt: skip
def test_recovery_of_points(name, recovery):
    """Oracle: figures computed independently; who does not react, or stops with its robot, does not recover."""
    times = [row["recovery_time"] for row in played(name, "failure")]
    assert times == pytest.approx([recovery] * 6, nan_ok=True)


def test_a_reference_that_runs_on_is_caught_up_with():
    """Oracle: 3.6 s where a robot may run at 7 omega, through the others; the law by hand for a slower one."""
    eager = partial(OnCurve, partial(TrackedReference, parameters=ReferenceParameters(runs_on=True, catch_up=6.0)))
    fast = played(eager, "failure", **{"robot.phase_rate_max": 7 * 0.3})
    assert [row["recovery_time"] for row in fast] == pytest.approx([3.6] * 6)
    assert mean(fast, "collisions") > 5 * mean(played("kuramoto", "failure"), "collisions")
    # The gap of 9.9 s closes at 1.5 omega down to 1.5 omega / k, then as exp(-k t); three of five robots are ahead of
    # the mean, so that the deviation is 0.05 rad where the gap of the other two is 0.05 / 0.6.
    gap, fastest = 0.3 * 9.9, 1.5 * 0.3
    expected = (gap - fastest) / fastest + math.log(fastest / (0.05 / 0.6))
    assert [row["recovery_time"] for row in played("running-reference", "failure")] == pytest.approx(
        [expected] * 6, abs=0.15
    )


def test_references_part_at_a_failure_alone():
    """Oracle: as long as nobody stops, both references are the same; so is the score, bit for bit."""
    disturbed = NO_FAULTS | {"noise.actuator": 0.01}
    one, other = (played(name, "failure", **disturbed) for name in ("tracked-reference", "running-reference"))
    assert [row["phase_error"] for row in one] == [row["phase_error"] for row in other]


def test_arc_spaces_points_by_arc_length():
    """Oracle: the arc length by quadrature, that of the knot in space; half as far off gaps of L / 5 as Kuramoto."""
    made = lissajous_env.scenario("knot", **BARE | NO_FAULTS)
    curve, gamma = made.curve, np.linspace(0, 2 * math.pi, 20_001)
    along = [
        curve.half_width * curve.a * np.sin(curve.a * gamma),
        curve.half_height * curve.b * np.cos(curve.b * gamma),
        curve.half_depth * curve.c * np.cos(curve.c * gamma),
    ]
    arc = cumulative_trapezoid(np.linalg.norm(along, axis=0), gamma, initial=0)

    def error(name):
        policy, simulation, errors = baselines.make(name, made), lissajous_env.Simulation(made, seed=1), []
        for _ in range(300):
            simulation.step(policy.act(simulation.observation))
            places = np.sort(np.interp(simulation.robots.phase.numpy()[0], gamma, arc))
            errors.append(np.abs(np.diff(places, append=places[0] + arc[-1]) - arc[-1] / 5).max())
        return np.mean(errors[100:])

    assert error("arc") < 0.5 * error("kuramoto")


# Cars: the coordinator and the tracker are distinguished.


def test_the_tracker_makes_the_collisions_of_the_vector_field():
    """Oracle: figures of 16 seeds computed independently: 1.06 with MPCC, 22.06 with the field, whoever coordinates."""
    collisions = [
        mean(played(name, "experiment", **NO_FAULTS), "collisions") for name in ("consensus-mpcc", "kuramoto-gvf")
    ]
    assert collisions == [pytest.approx(1.06, abs=1.5), pytest.approx(22.06, abs=6.0)]


def test_the_coordinator_makes_those_of_the_fault():
    """Oracle: figures computed independently, 5.1 collisions for Kuramoto and 10.9 for consensus, both with MPCC."""
    kuramoto, consensus = (
        mean(played(name, "experiment"), "collisions") for name in ("kuramoto-mpcc", "consensus-mpcc")
    )
    assert consensus > 1.3 * kuramoto
