"""Every coordinator over every tracker: each name plays, and is what it says."""

import math
from functools import partial

import numpy as np
import pytest

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
SEEDS = range(6)


def played(policy, scenario, seeds=SEEDS, **overrides):
    """Score rows of some seeds; the policy is a name, or a factory."""
    made = lissajous_env.scenario(scenario, **BARE | overrides)
    acting = baselines.make(policy, made, len(seeds)) if isinstance(policy, str) else policy(made, len(seeds), "cpu")
    return lissajous_env.evaluate(acting, made, seeds)


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


def test_the_coordinator_and_the_tracker_of_cars_are_distinguished():
    """Oracle: figures computed independently. Without a fault the tracker makes the collisions, after one both."""
    names = ("consensus-mpcc", "kuramoto-gvf")
    collisions = [mean(played(name, "experiment", **NO_FAULTS), "collisions") for name in names]
    assert collisions == [pytest.approx(1.06, abs=1.5), pytest.approx(22.06, abs=6.0)]
    kuramoto, consensus = (
        mean(played(f"{name}-mpcc", "experiment", range(24)), "collisions") for name in ("kuramoto", "consensus")
    )
    assert consensus > 1.3 * kuramoto
