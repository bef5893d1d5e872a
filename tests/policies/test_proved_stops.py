"""The proved filter where robots stop dead at the worst moments, and messages are lost."""

import numpy as np
import pytest
import warp as wp
from test_proved import FIVE, driven, towards_the_nearest

import lissajous_env
from baselines.policies.safety.proved import Proved, ProvedParameters
from baselines.policies.safety.tails import POINTS, Tail, gap_between, place_on, roll_on

FAILING = {"faults.rate": 1e-9, "faults.mean_duration": 1.0, "task.duration": 30.0}
"""Robots can fail, and the test chooses when."""


def stop_before_others(simulation, filter):
    """Robots that drive stop dead for 8 steps if another one drives at where they are."""
    position = simulation.robots.position.numpy()[..., :2]
    heading, speed = simulation.robots.heading.numpy(), simulation.robots.speed.numpy()
    offset = position[:, None] - position[:, :, None]
    far = np.linalg.norm(offset, axis=-1)
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)[:, :, None]
    towards = (offset * ahead).sum(axis=-1) > 0.9 * far
    radius, drag = simulation.scenario.robot.radius, simulation.scenario.robot.drag
    near = far < 2 * radius + speed[:, :, None] / drag
    threatened = (towards & near & (far > 0)).any(axis=1)
    until, now = simulation.robots.failed_until.numpy(), simulation.clock.step.numpy()[:, None]
    simulation.robots.failed_until.assign(np.where(threatened & (speed > 0.05) & (until < now), now + 8, until))


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
def measure_gaps(courses: wp.array3d(dtype=wp.vec3), stops: wp.array2d(dtype=int), out: wp.array(dtype=float)):
    """Measure the gap of the two courses in each row, beyond 0.1 m."""
    k = wp.tid()
    out[k] = gap_between(courses[k, 0], courses[k, 1], stops[k, 0] == 1, stops[k, 1] == 1, 0.1, -wp.inf)


def test_gap_of_courses_on_which_cars_may_stop_dead():
    """Oracle: the least distance of 20 x 20 points of each two pieces that can matter, in float64."""
    rng = np.random.default_rng(0)
    courses = rng.normal(0, 0.04, (200, 2, int(POINTS), 3)).cumsum(axis=2).astype(np.float32)
    courses[..., :2] += rng.uniform(-0.4, 0.4, (200, 2, 1, 2))
    courses[:20, 1] = courses[:20, 1, :1]  # a car that stands
    courses[20:30, 1, :, :2] = courses[20:30, 0, :, :2] + np.float32(0.2)  # parallel
    reach = np.linalg.norm(courses - courses[..., :1, :], axis=-1).max(axis=-1) + 0.02
    courses[..., 2] = rng.uniform(0, 0.02, (200, 2, int(POINTS)))
    courses[..., 0, 2] = reach
    stops = rng.choice([(0, 1), (1, 0), (1, 1)], 200).astype(np.int32)
    gaps = wp.zeros(200, dtype=float, device="cpu")
    given = [wp.array(courses, dtype=wp.vec3, device="cpu"), wp.array(stops, device="cpu")]
    wp.launch(measure_gaps, 200, given, [gaps], device="cpu")
    piece, share = np.arange(POINTS - 1), np.linspace(0, 1, 20)[:, None, None]
    for pair, stop, value in zip(courses.astype(float), stops, gaps.numpy(), strict=True):
        one, other = pair[:, None, :-1, :2] + share * np.diff(pair[..., :2], axis=1)[:, None]
        apart = np.linalg.norm(one[:, None, :, None] - other[None, :, None], axis=-1).min(axis=(0, 1))
        apart -= pair[0, 1:, None, 2] + pair[1, None, 1:, 2] + 0.1
        matters = (stop[0] | (piece[:, None] >= piece)) & (stop[1] | (piece >= piece[:, None])) == 1
        least = min(apart[matters].min(), 0.0)
        assert least - 0.01 < min(value, 0.0) < least + 1e-5


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
