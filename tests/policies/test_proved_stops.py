"""The proved filter where robots stop dead at the worst moments, and messages are lost."""

import numpy as np
import pytest
import warp as wp
from test_proved import FIVE, driven, towards_the_nearest

import lissajous_env
from baselines.policies.safety.proved import Proved, ProvedParameters
from baselines.policies.safety.tails import POINTS, Tail, gap_between, lay_out, place_on, roll_on, segment_distance

FAILING = {"faults.rate": 1e-9, "faults.mean_duration": 1.0, "task.duration": 30.0}
"""Robots can fail, and the test chooses when."""


def stop(simulation, chosen, steps=8):
    """Let chosen robots (W, N) that work stop dead in the next steps."""
    until = simulation.robots.failed_until.numpy()
    now = simulation.clock.step.numpy()[:, None]
    until = np.where(chosen & (until < now), now + steps, until)
    simulation.robots.failed_until.assign(until.astype(np.int32))


def stop_before_others(simulation, filter):
    """Robots that drive stop dead if another one drives at where they are; the others drive at their nearest."""
    position = simulation.robots.position.numpy()[..., :2]
    heading, speed = simulation.robots.heading.numpy(), simulation.robots.speed.numpy()
    offset = position[:, None] - position[:, :, None]
    far = np.linalg.norm(offset, axis=-1)
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)[:, :, None]
    towards = (offset * ahead).sum(axis=-1) > 0.9 * far
    radius, drag = simulation.scenario.robot.radius, simulation.scenario.robot.drag
    near = far < 2 * radius + speed[:, :, None] / drag
    threatened = (towards & near & (far > 0)).any(axis=1)
    stop(simulation, threatened & (speed > 0.05))


def test_robots_that_stop_dead_before_others_are_not_hit():
    """Oracle: the theorem. Robots stop where others are about to pass, again and again."""
    failing = lissajous_env.scenario(FIVE, **FAILING)
    stopped = []

    def on_step(simulation, filter):
        stopped.append((simulation.robots.status.numpy() == 1).mean())
        stop_before_others(simulation, filter)

    collisions, proved, broken, least = driven(failing, 60, 100, towards_the_nearest, seed=3, on_step=on_step)
    assert proved.mean() > 0.3
    assert np.mean(stopped) > 0.05
    assert collisions.sum() == 0
    assert not broken.any()
    assert least >= 1


def test_robots_assumed_to_coast_are_hit_where_they_stop_dead():
    """Story: the same adversary collides with robots whose sudden stops the filter does not consider."""
    failing = lissajous_env.scenario(FIVE, **FAILING)
    assumed = lissajous_env.scenario(failing, **{"faults.stop": "coast"})
    collisions, *_ = driven(failing, 60, 100, towards_the_nearest, seed=3, on_step=stop_before_others, assumed=assumed)
    assert collisions.sum() > 0


@wp.kernel
def measure_gaps(ends: wp.array2d(dtype=wp.vec3), out: wp.array(dtype=float)):
    """Measure the distance of two segments in each row."""
    k = wp.tid()
    out[k] = segment_distance(ends[k, 0], ends[k, 1], ends[k, 2], ends[k, 3])


def test_distance_of_segments():
    """Oracle: the least distance of 200 x 200 points of the segments, in float64."""
    rng = np.random.default_rng(0)
    ends = np.zeros((80, 4, 3), dtype=np.float32)
    ends[..., :2] = rng.uniform(-1, 1, (80, 4, 2))
    ends[:20, 1] = ends[:20, 0]  # a point
    ends[20:30, 2:] = ends[20:30, :2] + np.float32(0.5)  # parallel
    gaps = wp.zeros(80, dtype=float, device="cpu")
    wp.launch(measure_gaps, 80, [wp.array(ends, dtype=wp.vec3, device="cpu")], [gaps], device="cpu")
    share = np.linspace(0, 1, 200)[:, None]
    for (a, a_end, b, b_end), value in zip(ends[..., :2].astype(float), gaps.numpy(), strict=True):
        one, other = a + share * (a_end - a), b + share * (b_end - b)
        least = np.linalg.norm(one[:, None] - other, axis=-1).min()
        assert least - 0.02 < value < least + 1e-5


@wp.kernel
def compare(arcs: wp.array3d(dtype=float), stops: wp.array2d(dtype=int), courses: wp.array3d(dtype=wp.vec3)):
    """Replace x of each pair's first place by the gap of its courses, which are arcs without errors."""
    k = wp.tid()
    for c in range(2):
        begin = wp.vec3(arcs[k, c, 0], arcs[k, c, 1], arcs[k, c, 2])
        tail = Tail(begin, arcs[k, c, 3], arcs[k, c, 4], 0.0, wp.vec3())
        lay_out(courses[k, c], wp.vec2(begin[0], begin[1]), wp.vec3(begin[0], begin[1], 0.0), tail, 0.0)
    arcs[k, 0, 0] = gap_between(courses[k, 0], courses[k, 1], stops[k, 0] == 1, stops[k, 1] == 1, 0.3, -wp.inf)


def test_gap_of_tails_is_that_of_all_places_at_which_cars_may_stand():
    """Oracle: the least distance of 200 places of either arc in closed form, of all times at which it can matter."""
    rng = np.random.default_rng(0)
    arcs, stops = rng.uniform([-0.7, -0.7, 0, 0.1, 1], [0.7, 0.7, 6, 1.2, 4], (400, 2, 5)), rng.integers(0, 2, (400, 2))
    x, y, heading, length, curvature = np.moveaxis(arcs, -1, 0)[..., None]
    gaps = wp.array(arcs, dtype=float, device="cpu")
    courses = wp.zeros((400, 2, int(POINTS)), dtype=wp.vec3, device="cpu")
    wp.launch(compare, 400, [gaps, wp.array(stops, dtype=int, device="cpu"), courses], device="cpu")
    q = np.linspace(0, 1, 200)
    turned = heading + curvature * length * q
    place = x + (np.sin(turned) - np.sin(heading)) / curvature, y - (np.cos(turned) - np.cos(heading)) / curvature
    one, other = np.stack(place, axis=-1).swapaxes(0, 1)
    apart = np.linalg.norm(one[:, :, None] - other[:, None], axis=-1) - 0.3
    sooner = np.sign(q - q[:, None])  # of the first car: 1 where its place is that of an earlier time
    matters = ((sooner <= 0) | (stops[:, :1, None] == 1)) & ((sooner >= 0) | (stops[:, 1:, None] == 1))
    truth = np.where(matters, apart, 0.0).min(axis=(1, 2), initial=0.0)
    gap = np.minimum(gaps.numpy()[:, 0, 0], 0.0)
    assert (truth < 0).mean() > 0.2
    assert (gap < truth + 1e-5).all()
    assert (gap > truth - 0.05).all()  # within a piece, both cars may stop


@wp.kernel
def roll(tail: Tail, left: float, out: wp.array2d(dtype=float)):
    """Write place, heading and bound of the error at five shares of the rest of a tail."""
    rest = roll_on(tail, left)
    for k in range(5):
        q = 0.25 * float(k)
        place = place_on(rest, q)
        for c in range(3):
            out[k, c] = place[c]
        out[k, 3] = rest.w[0] + q * (rest.w[1] + q * rest.w[2])


def test_the_rest_of_a_tail_is_on_the_tail():
    """Oracle: the arc and its bound in float64, at the shares of the whole tail."""
    x, y, heading, length, curvature, w = 0.3, -0.2, 0.7, 1.2, 1.5, (0.01, 0.05, 0.03)
    tail, points = Tail(), wp.zeros((5, 4), dtype=float, device="cpu")
    tail.begin, tail.length, tail.curvature, tail.w = wp.vec3(x, y, heading), length, curvature, wp.vec3(*w)
    wp.launch(roll, 1, [tail, 0.6], [points], device="cpu")
    q = 1 - 0.6 * (1 - np.linspace(0, 1, 5))
    turned = heading + curvature * length * q
    place = x + (np.sin(turned) - np.sin(heading)) / curvature, y - (np.cos(turned) - np.cos(heading)) / curvature
    expected = np.stack([*place, turned, w[0] + w[1] * q + w[2] * q**2], axis=-1)
    np.testing.assert_allclose(points.numpy(), expected, atol=1e-6)


@pytest.mark.parametrize("repeats", [1, 3])
def test_a_tail_is_lost_only_if_each_of_its_messages_is(repeats):
    """Oracle: a robot decides if it has heard all others, with probability (1 - loss^repeats)^(N - 1)."""
    wide = {"curve.half_width": 60.0, "curve.half_height": 60.0, "formation.phase_rate": 0.01}
    lossy = lissajous_env.scenario(FIVE, **wide, **{"noise.message_loss": 0.5})
    simulation = lissajous_env.Simulation(lossy, 2000, seed=1)
    filter = Proved(simulation.scenario, 2000, parameters=ProvedParameters(repeats=repeats))
    wanted = np.full(simulation.action_shape, 0.3, dtype=np.float32)
    action = filter(simulation.observation, wp.array(wanted, dtype=wp.float32, device="cpu")).numpy()
    assert (action == wanted).all(axis=-1).mean() == pytest.approx((1 - 0.5**repeats) ** 4, abs=0.02)
