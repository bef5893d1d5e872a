"""Work of a step, counted in comparisons of a target with a robot: a field changes it only for a reason."""

import contextlib
import dataclasses

import pytest
import warp as wp

import lissajous_env
from lissajous_env.device.abreast import Floats
from lissajous_env.device.compilation import MOTION, module_apart
from lissajous_env.world import stages
from lissajous_env.world.robots.bins import Bins, bin_of
from lissajous_env.world.robots.sight import first_sight_listed, leaves_lists, nearest_listed_together
from lissajous_env.world.state import Robots
from lissajous_env.world.targets import detection

MODULE = module_apart(f"{__name__}.counted", MOTION)


@wp.func
def listed(w: int, place: wp.vec2, bins: Bins) -> int:
    """Return the length of the list of a place."""
    count = int(0)
    entry = bins.entry[w, bins.first[w, bin_of(place, bins)]]
    while entry[0] >= 0:
        count += 1
        entry = bins.entry[w, entry[1]]
    return count


@wp.func
def counted_nearest(w: int, count: int, x: Floats, y: Floats, within: Floats, robots: Robots, bins: Bins):
    nearest, least = nearest_listed_together(w, count, x, y, within, robots, bins)
    for k in range(count):
        wp.atomic_add(bins.used, w, listed(w, wp.vec2(x[k], y[k]), bins))
        if within[k] > bins.reach and least[k] > bins.reach * bins.reach:
            wp.atomic_add(bins.used, w, robots.sensor.shape[1])
    return nearest, least


@wp.func
def counted_sight(w: int, before: wp.vec2, after: wp.vec2, radius: float, reach: float, robots: Robots, bins: Bins):
    if leaves_lists(before, after, radius, bins):
        wp.atomic_add(bins.used, w, robots.sensor.shape[1])
    else:
        wp.atomic_add(bins.used, w, listed(w, before, bins))
    return first_sight_listed(w, before, after, radius, reach, robots, bins)


COUNTED = detection._moving_and_detecting(counted_nearest, counted_sight, detection.list_in_sight, MODULE)
CROWD = {"curve.a": 201, "curve.b": 200, "robot.radius": 0.001, "targets.count": 2000, "task.grid": None}
BASES = {
    "all wander": {},
    "none moves": {"targets.wandering": 0.0},
    "one in a hundred flees": {"targets.wandering": 0.99, "targets.fleeing": 0.01},
}
VALUES = (0, 1e-3, 0.1, 1, 50, 1e5, None, True, False, "unseen", "boundary")
PARTS = ("targets", "sensing", "noise", "faults")
WITH_REASON = {
    "targets.speed", "targets.fleeing", "targets.count", "sensing.radius", "sensing.sight", "noise.actuator",
}  # fmt: skip
"""Fields that bring more robots near a target: targets or robots go farther in a step, or discs are larger."""
MOST = 2.5
"""Largest factor by which another field may change the work of a target."""


def fields():
    scenario = lissajous_env.scenario("swarm")
    names = [f"{part}.{field.name}" for part in PARTS for field in dataclasses.fields(getattr(scenario, part))]
    return [name for name in names if name not in WITH_REASON]


def comparisons(overrides, steps=3):
    """Return the comparisons with robots for each target and step."""
    scenario = lissajous_env.scenario("swarm", **{**CROWD, **overrides})
    simulation, total = lissajous_env.Simulation(scenario, seed=1, threads=1), 0
    bins = simulation.stages._values["bins"]
    for _ in range(steps):
        simulation.advance()
        total += int(bins.used.numpy()[0])
    present = (simulation.targets.appears_at.numpy() <= steps).sum()
    return total / steps / max(present, 1)


def accepted(name, base):
    """Yield overrides with each of `VALUES` that a scenario accepts for a field."""
    for value in VALUES:
        overrides = {**base, name: value}
        with contextlib.suppress(ValueError):
            lissajous_env.scenario("swarm", **{**CROWD, **overrides}).resolve()
            yield overrides


@pytest.fixture(scope="module")
def counting():
    """Make simulations count comparisons instead of the entries of lists, which are counted before targets move."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "move_and_detect_listed", COUNTED)
        yield {name: comparisons(base) for name, base in BASES.items()}


@pytest.mark.parametrize("base", BASES)
def test_a_target_is_compared_with_few_of_many_robots(base, counting):
    # Oracle: all robots, with each of which every target was once compared.
    robots = lissajous_env.scenario("swarm", **CROWD).resolve().num_robots
    assert 0.1 < counting[base] < robots / 50


@pytest.mark.parametrize("base", BASES)
def test_a_field_alone_does_not_multiply_the_work(base, counting):
    # Oracle: the work before the field was changed. Fields of other parts than targets act alike on all of these.
    for name in fields():
        if name.startswith("targets.") or base == "all wander":
            for overrides in accepted(name, BASES[base]):
                assert comparisons(overrides, 2) < MOST * counting[base] + 0.5, overrides


@pytest.mark.parametrize("name", ["targets.speed", "targets.flee_speed", "targets.flee_radius"])
def test_the_motion_of_targets_that_there_are_not_changes_nothing(name, counting):
    # Oracle: the scenario without the change, to the last comparison.
    for overrides in accepted(name, BASES["none moves"]):
        assert comparisons(overrides) == counting["none moves"]
