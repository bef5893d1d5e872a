"""Check the assumptions of the paper for a scenario.

A scenario that violates an assumption can still be played, and some included scenarios violate one on purpose. Most
assumptions are also necessary for a robot to follow the curve at all.
"""

import warnings
from collections.abc import Iterable, Iterator
from functools import cache

from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import included_scenarios
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.wording import outside

_OBSERVED = 4
"""Largest speed in an observation [top speeds], as in `lissajous_env.world.observation.OWN_ENTRIES`."""
_reported: set[str] = set()
"""Violated assumptions about which this process has already warned."""


class AssumptionWarning(UserWarning):
    """Warning that a scenario violates an assumption of the paper or of a policy, with the numbers."""


def violations(scenario: Scenario) -> tuple[str, ...]:
    """Return a sentence with numbers for each assumption that a scenario violates."""
    return (*_of_formation(scenario), *_of_robots(scenario))


def warn_of_violations(scenario: Scenario, allowed: Iterable[str] = ()) -> None:
    """Warn about violated assumptions that are new in this process, not allowed, and in no included scenario.

    Where actions are velocities, no policy follows the formation, and nothing is reported.
    """
    if not scenario.has_formation:
        return
    known = {*_reported, *allowed, *_violated_on_purpose()}
    if new := [words for words in violations(scenario) if words not in known]:
        _reported.update(new)
        warnings.warn(f"scenario {scenario.name}: {'; '.join(new)}", AssumptionWarning, stacklevel=outside())


def quietly() -> warnings.catch_warnings:
    """Return a context in which nothing is reported, for scenarios that violate assumptions on purpose."""
    return warnings.catch_warnings(action="ignore", category=AssumptionWarning)


@cache
def _violated_on_purpose() -> frozenset[str]:
    return frozenset(words for scenario in included_scenarios().values() for words in violations(scenario))


def _of_formation(scenario: Scenario) -> Iterator[str]:
    n, p, kappa, curve = scenario.num_robots, scenario.p, scenario.clusters, scenario.driven
    if n > 1 and p not in closed_forms.stable_equilibria(n):
        yield f"p = {p} of {n} robots is not a stable equilibrium: p must be between N / 4 and 3 N / 4 (Theorem 1)"
    if curve.harmonics:
        return  # the paper's bounds apply to Lissajous curves only
    if kappa > 1:
        yield f"{kappa} of {n} robots share each place on the curve, so that their bodies overlap (Lemma 1)"
    if not scenario.has_places:
        robots = f"{n} robots" if kappa == 1 else f"{n} robots on {n // kappa} places"
        places = f"a curve with a + b = {curve.a + curve.b}"
        yield f"{robots} on {places}: the paper's bounds require N = a + b (robot.count)"
        return
    if kappa == 1 and not closed_forms.ring_lies_on_ellipse(curve, n, p, scenario.alpha):
        words = "ring neighbours are not neighbours on the ellipse (5)"
        yield f"alpha = {scenario.alpha} and p = {p}: {words}, a alpha p must be 1 or -1 modulo N (Lemma 2)"
    radius, allowed = scenario.robot.radius, scenario.robot_radius_bound
    if kappa == 1 and radius >= allowed:
        words = f"bodies of {radius:.4g} m, bound (6) allows {allowed:.4g} m"
        yield f"{words}: robots of the undisturbed formation may collide (robot.radius)"
    if not scenario.senses_neighbours:
        words = f"sensors reach {scenario.sensing_radius:.4g} m, (8) requires {scenario.detection_radius:.4g} m"
        yield f"{words}: T_max does not bound the detection time (sensing.radius)"


def _of_robots(scenario: Scenario) -> Iterator[str]:
    curve, rate, robot, more = scenario.driven, scenario.formation.phase_rate, scenario.robot, 1 + geometry.SLACK
    wanted = rate / scenario.alpha
    if robot.kind == "curve" and robot.phase_rate_max is not None and wanted > robot.phase_rate_max * more:
        reached = f"the points reach {robot.phase_rate_max:.4g} rad/s (robot.phase_rate_max)"
        yield f"the formation moves at omega / alpha = {wanted:.4g} rad/s, {reached}"
    if robot.kind not in ("car", "differential"):
        return
    speed, bends = geometry.along_lap(curve)
    fastest, slowest = rate * float(speed.max()), rate * float(speed.min())
    if fastest > robot.top_speed * more:
        share = float(speed[speed * rate > robot.top_speed].sum() / speed.sum())
        reached = f"the robots reach {robot.top_speed:.3g} m/s (robot.speed_max, formation.phase_rate)"
        yield f"the curve requires up to {fastest:.3g} m/s, {reached}; {share:.1%} of the arc is faster"
    if robot.kind == "differential":
        return
    observed = _OBSERVED * robot.top_speed
    if scenario.top_speed_bound > observed * more:
        words = f"observed speeds are at most {observed:.3g} m/s, {_OBSERVED} top speeds: policies read too low a speed"
        strongest = f"the strongest car reaches {scenario.top_speed_bound:.3g} m/s"
        yield f"{strongest}, {words} (noise.drive_spread, robot.drive_factors)"
    required = f"the curve requires {slowest:.3g} to {fastest:.3g} m/s"
    if robot.idle_speed > fastest * more:
        yield f"the cars drive at {robot.idle_speed:.3g} m/s at least (robot.throttle_min), {required}"
    jump = (robot.drive * robot.dead_zone - robot.offset) / robot.drag
    if robot.throttle_min <= robot.dead_zone and jump > slowest + geometry.SLACK * fastest:
        yield f"above robot.dead_zone, the motor leads to {jump:.3g} m/s at least (robot.offset), {required}"
    turning = geometry.turning_radius(robot.wheelbase, robot.steering_max)
    bend, share = float(bends.min()), geometry.tight_share(curve, turning)
    if bend < turning * (1 - geometry.SLACK):
        turns = f"the cars turn at {turning:.3g} m (robot.wheelbase); {share:.1%} of the arc is tighter"
        yield f"the curve bends at a radius of {bend:.2g} m, {turns}"
    grip = robot.lateral_acceleration_max
    wanted = rate**2 * geometry.needed_acceleration(curve, turning)
    if wanted > grip * more:
        words = f"the cars grip up to {grip:.3g} m/s^2 (robot.lateral_acceleration_max)"
        yield f"the curve requires a lateral acceleration of {wanted:.3g} m/s^2, {words}"
