"""Tasks with feedback: sight beyond detection, targets that stay or appear anew, hotspots, flight."""

import math

import numpy as np
import pytest

import lissajous_env

FIELD = {
    "curve.half_width": 20.0, "curve.half_height": 12.5, "robot.count": 5, "robot.radius": 0.4, "robot.wheelbase": 0.8,
    "robot.steering_max": 0.45, "robot.speed_max": 1.5, "robot.throttle_max": None, "formation.p": 2,
    "formation.start": "random", "formation.start_noise": 0.0, "formation.phase_rate": 0.02, "sensing.radius": 3.0,
    "targets.arrival_rate": 0.0, "targets.count": 12, "targets.entry": "inside", "targets.speed": 1.0,
    "targets.wandering": 0.5, "targets.fleeing": 0.5, "targets.flee_radius": 6.0, "targets.flee_speed": 1.0,
    "task.step": 0.5, "task.substeps": 5, "task.duration": 60.0, "task.grid": None, "task.boundary": "wall",
}  # fmt: skip
pytestmark = pytest.mark.filterwarnings("ignore::lissajous_env.parameters.assumptions.AssumptionWarning")


def field(worlds=2, seed=0, **overrides):
    return lissajous_env.Simulation(lissajous_env.scenario("intruders", **FIELD | overrides), worlds, seed=seed)


def drive(simulation, steps=100):
    """Let the robots drive at random for some steps, and yield the number of each."""
    draw = np.random.default_rng(5)
    for step in range(steps):
        simulation.step(draw.uniform(-1, 1, simulation.action_shape).astype(np.float32))
        yield step


def distances(simulation):
    """(W, N, T) distances of the working robots from the targets [m]."""
    places, sensors = simulation.targets.position.numpy(), simulation.robots.sensor.numpy()
    return np.linalg.norm(places[:, None] - sensors[:, :, None], axis=-1)


# Sight.


def test_targets_and_robots_within_sight_are_observed_and_those_within_the_radius_detected():
    # Oracle: NumPy distances; and the same worlds with a sight of the sensing radius, in which the same is detected.
    near, far = field(), field(**{"sensing.sight": 8.0, "sensing.targets_seen": 12})
    for _ in zip(drive(near), drive(far), strict=True):
        status = far.targets.status.numpy()
        there = (status == 1) | (status == 2)
        gap = distances(far)
        np.testing.assert_array_equal(far.targets.in_sight.numpy() == 1, (gap.min(axis=1) < 8.0) & there)
        names = [far.layout.names.index(f"target_{k}_present") for k in range(12)]
        listed = far.observation.numpy()[..., names].sum(axis=-1)
        np.testing.assert_array_equal(listed, ((gap < 8.0) & there[:, None]).sum(axis=-1))
        np.testing.assert_array_equal(far.targets.found_at.numpy(), near.targets.found_at.numpy())
    assert far.score()[0]["detected_fraction"] > 0.2


@pytest.mark.parametrize(
    ("field_name", "value", "rule"),
    [
        ("sensing.sight", 2.0, r"sensing.sight must be at least the sensing radius, 3 \[m\], got 2.0"),
        ("targets.speed_min", 1.2, r"targets.speed_min must be at most speed = 1 \[m/s\], got 1.2"),
        ("targets.leave", False, "targets.respawn must be False if targets do not leave, got True"),
        ("task.contamination", (40, 25), r"targets.arrival_rate must be above 0 if targets appear anew .* got 0"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(field_name, value, rule):
    with pytest.raises(ValueError, match=rule):
        field(**{"targets.respawn": True, field_name: value})


# Targets that stay.


def test_the_observed_share_is_that_of_targets_in_sight():
    # Oracle: NumPy, over the steps after the reset.
    simulation = field(**{"targets.leave": False, "sensing.sight": 4.0})
    shares = [(distances(simulation).min(axis=1) < 4.0).mean(axis=-1) for _ in drive(simulation)]
    scores = [row["observed_fraction"] for row in simulation.score()]
    assert scores == pytest.approx(np.mean(shares, axis=0))
    assert all(math.isnan(row["observed_fraction"]) for row in field().score())


# Targets that appear anew.


def test_a_detected_target_appears_anew_and_every_life_counts():
    # Oracle: the detections of each step, and times from the slots' own clocks as they were in each step.
    simulation = field(**{"targets.respawn": True})
    total, times = np.zeros(2), [[], []]
    for _ in drive(simulation, 119):
        total += simulation.latest.detections.numpy().sum(axis=1)
        targets = {
            name: getattr(simulation.targets, name).numpy() for name in ("appears_at", "found_at", "found_early")
        }
        now = simulation.clock.step.numpy()[0]
        for w, t in np.argwhere(targets["found_at"] == now):
            times[w].append(0.5 * (now - targets["found_early"][w, t] - targets["appears_at"][w, t]))
        assert (simulation.targets.status.numpy() != 3).all(), "nobody is gone for good"
    at_reset = [int((simulation.targets.earlier.numpy()[w] > 0).sum()) for w in range(2)]
    assert min(at_reset) > 0
    for w, row in enumerate(simulation.score()):
        detected = round(row["detected_fraction"] * row["targets"])
        missed = detected - total[w]  # of the reset
        assert 0 <= missed <= 12
        assert row["detection_rate"] == pytest.approx(detected / (119 * 0.5 / 60))
        undetected = simulation.targets.status.numpy()[w] == 1
        left = 0.5 * (119 - simulation.targets.appears_at.numpy()[w][undetected])
        expected = (sum(times[w]) + left.sum()) / row["targets"]
        assert row["detection_time_mean"] == pytest.approx(expected, rel=1e-5)
        assert row["detection_time_max"] == pytest.approx(max([*times[w], *left]), rel=1e-5)
        assert row["targets"] == detected + undetected.sum()


# Hotspots.


def test_hotspots_differ_between_worlds_and_targets_are_spread_around_them():
    # Oracle: for one hotspot, the sample deviation in each world; the share that is anywhere is far from the place.
    spots = {"targets.entry": "hotspots", "targets.hotspots": 1, "targets.hotspot_spread": 0.5, "targets.count": 400}
    places = field(60, **spots).targets.position.numpy().astype(float)
    middle = np.median(places, axis=1)
    gap = places - middle[:, None]
    far = np.linalg.norm(gap, axis=-1) > 2.5
    assert far.mean() == pytest.approx(0.1, abs=0.01)
    assert gap[~far].std() == pytest.approx(0.5, rel=0.03)
    # The middle is uniform in 85 % of each side, so its variance is a third of the square of half of that.
    assert (middle / (0.85 * np.array([20.0, 12.5]))).var(axis=0) == pytest.approx(1 / 3, rel=0.35)
    assert np.abs(middle / [20.0, 12.5]).max() <= 0.87


def test_hotspots_have_weights_of_a_gamma_distribution():
    # Oracle: with two hotspots, the share of one is a beta variate of (2, 2), of variance 1 / 20.
    spots = {"targets.entry": "hotspots", "targets.hotspots": 2, "targets.hotspot_spread": 0.01, "targets.count": 300}
    places = field(200, **spots, **{"targets.hotspot_uniform": 0.0}).targets.position.numpy().astype(float)
    far = np.linalg.norm(places - places[:, :1], axis=-1) > 0.2
    first = 1 - far.mean(axis=1)  # the share of the hotspot of the first target
    # That target picks a hotspot by its share: the mean of p^2 + (1 - p)^2 = 1 - 2 E[p (1 - p)] = 0.6.
    assert first.mean() == pytest.approx(0.6, abs=0.04)


# Speeds and flight.


def test_each_target_has_a_speed_of_its_own():
    # Oracle: the distances between ends of steps, of targets that do not bounce; uniform in the range.
    overrides = {"targets.speed_min": 0.4, "targets.drifting": 1.0, "targets.wandering": 0.0, "targets.fleeing": 0.0}
    simulation = field(20, **overrides, **{"targets.leave": False, "targets.count": 50})
    before = simulation.targets.position.numpy().copy()
    for _ in drive(simulation, 1):
        speeds = np.linalg.norm(simulation.targets.position.numpy() - before, axis=-1) / 0.5
    straight = (np.abs(before) < [19.4, 11.9]).all(axis=-1)
    np.testing.assert_allclose(speeds[straight], simulation.targets.speed.numpy()[straight], rtol=1e-4)
    assert speeds[straight].mean() == pytest.approx(0.7, abs=0.02)
    assert speeds[straight].var() == pytest.approx(0.6**2 / 12, rel=0.1)
    assert (speeds[straight] > 0.39).all()


def test_a_target_flees_from_all_robots_and_walls():
    # Oracle: the sum of unit vectors, each over the distance, in NumPy, also for targets that begin on a wall.
    overrides = {"targets.flight": "all", "targets.fleeing": 1.0, "targets.wandering": 0.0, "targets.leave": False}
    simulation = field(20, **overrides, **{"targets.flee_radius": 9.0})
    half = np.array([20.0, 12.5])
    before, tested = simulation.targets.position.numpy().astype(float), 0
    before[:, :2, 0], before[:, 2:4, 1] = [-20.0, 20.0], [-12.5, 12.5]
    simulation.targets.position.assign(before)
    for _ in drive(simulation, 30):
        sensors, after = simulation.robots.sensor.numpy().astype(float), simulation.targets.position.numpy()
        gap = before[:, :, None] - sensors[:, None]
        far = np.linalg.norm(gap, axis=-1)
        force = (gap / far[..., None] * np.where(far < 9.0, 1 / np.maximum(far, 0.45), 0.0)[..., None]).sum(axis=2)
        force += 0.5 / np.maximum(half + before, 0.45) - 0.5 / np.maximum(half - before, 0.45)
        length = np.linalg.norm(force, axis=-1)
        sure = (far.min(axis=-1) < 8.99) & (length > 0.01)
        expected = np.clip(before + 0.5 * force / length[..., None], -half, half)
        np.testing.assert_allclose(after[sure], expected[sure], atol=2e-3)
        tested += sure.sum()
        before = after.astype(float)
    assert tested > 500
