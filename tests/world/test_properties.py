"""Properties of every world: Hypothesis generates scenarios and actions.

Oracle: ranges that follow from the definitions, and logical relations between returned values.
"""

import contextlib
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import lissajous_env
from lissajous_env.world.columns import COLUMNS
from lissajous_env.world.state import NEVER

STEPS = 40
WORLDS = 3
FORMATION = "lateral_error", "tracking_error", "spacing_factor", "phase_error", "recovery_time"
"""Beginnings of the columns that are empty where actions are velocities."""


@st.composite
def scenarios(draw):
    """Any scenario of up to nine robots whose episode is 40 steps long."""
    kind = draw(st.sampled_from(["car", "curve"]))
    a = draw(st.sampled_from([1, 3, 5, 7]))
    b = draw(st.integers(1, 8).filter(lambda b: math.gcd(a, b) == 1))
    count = draw(st.one_of(st.none(), st.integers(1, 9)))
    n = a + b if count is None else count
    robots = st.integers(0, n - 1)
    shares = draw(st.lists(st.floats(0, 1), min_size=4, max_size=4))
    total = sum(shares) or 1.0
    step = draw(st.sampled_from([0.05, 0.1, 0.3]))
    times = st.floats(0, 1.2 * STEPS * step)
    faults = draw(st.lists(st.tuples(robots, times, times), max_size=3))
    noise = st.sampled_from([0.0, 0.0, 0.05, 0.5])
    overrides = {
        "curve.half_width": draw(st.floats(0.3, 50)),
        "curve.half_height": draw(st.floats(0.3, 50)),
        "curve.a": a,
        "curve.b": b,
        "curve.half_depth": draw(st.sampled_from([0.0, 1.0])) if kind == "curve" else 0.0,
        "formation.ring": tuple(draw(st.permutations(range(n)))),
        "formation.p": draw(st.one_of(st.none(), st.integers(0, n))),
        "formation.alpha": draw(st.one_of(st.none(), st.integers(1, 7))),
        "formation.start": draw(st.sampled_from(["equilibrium", "rotated", "random"])),
        "formation.start_noise": draw(noise),
        "robot.kind": kind,
        "robot.count": count,
        "robot.radius": draw(st.floats(0.001, 1)),
        "robot.lateral_acceleration_max": draw(st.sampled_from([math.inf, 2.0, 0.1])),
        "sensing.radius": draw(st.one_of(st.none(), st.floats(0.01, 60))),
        "sensing.targets_seen": draw(st.integers(0, 6)),
        "sensing.robots_seen": draw(st.integers(0, 6)),
        "targets.count": draw(st.integers(0, 20)),
        "targets.arrival_rate": draw(st.sampled_from([0.0, 0.5, 5.0])),
        "targets.entry": draw(st.sampled_from(["inside", "boundary", "unseen", "hotspots"])),
        "targets.flight": draw(st.sampled_from(["nearest", "all"])),
        "targets.speed_min": draw(st.sampled_from([None, 0.0])),
        "targets.drifting": shares[0] / total,
        "targets.wandering": shares[1] / total,
        "targets.fleeing": shares[2] / total,
        "targets.speed": draw(st.floats(0, 20)),
        "targets.flee_speed": draw(st.floats(0, 20)),
        "targets.leave": draw(st.booleans()),
        "faults.schedule": tuple((i, min(s, e), max(s, e) + step) for i, s, e in faults),
        "faults.removed": tuple(draw(st.lists(st.tuples(robots, times), max_size=2))),
        "faults.rate": draw(st.sampled_from([0.0, 0.5])),
        "faults.lost": draw(st.integers(0, min(n, 2))),
        "noise.actuator": draw(noise),
        "noise.position": draw(noise),
        "noise.heading": draw(noise),
        "noise.speed": draw(noise),
        "noise.message_loss": draw(st.sampled_from([0.0, 0.3, 1.0])),
        "noise.message_delay": draw(st.sampled_from([0.0, 0.2])),
        "task.duration": STEPS * step,
        "task.step": step,
        "task.action": draw(st.sampled_from(["control", "velocity"])) if kind == "car" else "control",
        "task.substeps": draw(st.integers(1, 3)),
        "task.grid": draw(st.one_of(st.none(), st.tuples(st.integers(1, 40), st.integers(1, 12)))),
        "task.on_collision": draw(st.sampled_from(["count", "stop", "remove"])),
        "task.boundary": draw(st.sampled_from(["open", "wall", "remove"])),
        "task.reward_outside": draw(st.sampled_from([0.0, -1.0])),
        "task.reward_idleness": draw(st.sampled_from([0.0, 1.0])),
        "task.reward_effort": draw(st.sampled_from([0.0, -1.0])),
    }
    if overrides["sensing.radius"] is not None:
        overrides["sensing.sight"] = draw(st.sampled_from([None, 2 * overrides["sensing.radius"]]))
    overrides["targets.respawn"] = overrides["targets.leave"] and draw(st.booleans())
    half = min(overrides["curve.half_width"], overrides["curve.half_height"])
    if overrides["task.boundary"] == "wall":  # walls leave room for bodies, and sensors reach them
        overrides["robot.radius"] = min(overrides["robot.radius"], 0.2 * half)
        overrides |= {"curve.inset": overrides["robot.radius"], "sensing.radius": None, "sensing.sight": None}
    columns = draw(st.integers(1, 40))
    rows = max(round(columns * overrides["curve.half_height"] / overrides["curve.half_width"]), 1)
    with contextlib.suppress(ValueError):  # cells that are too long, or too small for rogues as fast as these
        return lissajous_env.scenario("experiment", **overrides, **{"task.contamination": (columns, rows)})
    return lissajous_env.scenario("experiment", **overrides)


@settings(max_examples=25, derandomize=True)
@given(scenario=scenarios(), seed=st.integers(0, 2**20))
def test_every_world_keeps_its_promises(scenario, seed):
    simulation = lissajous_env.Simulation(scenario, WORLDS, seed=seed)
    low, high = simulation.layout.low, simulation.layout.high
    sensed = np.flatnonzero([name.startswith(("robot_", "target_")) for name in simulation.layout.names])
    present = [k for k, name in enumerate(simulation.layout.names) if name.endswith("_present")]
    half = np.float32([scenario.curve.half_width, scenario.curve.half_height])
    draw = np.random.default_rng(seed)
    covered = np.zeros(WORLDS)
    for now in range(STEPS + 1):
        if now:
            simulation.step(draw.uniform(-1.3, 1.3, simulation.action_shape).astype(np.float32))
        rows = simulation.observation.numpy()
        assert np.isfinite(rows).all()
        assert ((rows >= low) & (rows <= high)).all()
        status = simulation.robots.status.numpy()
        assert (rows[..., 7] == (status == 0)).all()
        assert (rows[status != 0][:, sensed] == 0).all(), "a robot that does not work senses nothing"
        assert (rows[status == 2][:, 7:] == 0).all(), "a removed robot hears nothing"
        assert np.isin(rows[..., present], [0, 1]).all()
        assert np.isfinite(simulation.reward.numpy()).all()
        assert not simulation.invalid.numpy().any()
        contact = simulation.tally.contact.numpy()
        assert (np.tril(np.abs(contact).sum(axis=0)) == 0).all(), "no robot with itself, no pair twice"
        phases = simulation.robots.phase.numpy()
        assert ((phases >= 0) & (phases < 2 * math.pi)).all()
        assert (simulation.robots.speed.numpy() >= 0).all()
        there = simulation.targets.status.numpy() > 0
        assert (np.abs(simulation.targets.position.numpy()[there]) <= half).all()
        now_covered = simulation.tally.covered.numpy()
        assert (now_covered >= covered).all()
        covered = now_covered.copy()
        if not simulation.over.any():
            assert simulation.clock.step.numpy().tolist() == [now] * WORLDS
    assert simulation.over.all()
    assert_score_in_range(scenario, simulation)


def assert_score_in_range(scenario, simulation):
    """Compare the score with the rules of its columns, and columns with each other."""
    duration, longest = scenario.task.duration, max(scenario.curve.half_width, scenario.curve.half_height)
    for row in simulation.score():
        for name, column in COLUMNS.items():
            value = row[name]
            assert not column.refusal(None if math.isnan(value) else value), name
            assert not name.endswith("time") or math.isnan(value) or value <= duration * simulation.num_robots**2, name
        guarantee, again = row["guaranteed_detection_time"], scenario.targets.respawn
        assert math.isnan(guarantee) == (scenario.task.contamination is None)
        if not math.isnan(guarantee):
            assert row["contaminated_age_mean"] <= guarantee <= duration + 1e-6
            assert row["unseen_at_end"] <= guarantee
        assert math.isnan(row["detected_fraction"]) == (row["targets"] == 0)
        assert again or not (math.isnan(row["detected_within_bound"]) and row["detected_fraction"] > 0)
        assert math.isnan(row["observed_fraction"]) == (scenario.targets.leave or row["targets"] == 0)
        assert math.isnan(row["detection_rate"]) != again
        assert row["targets"] <= scenario.target_capacity * (STEPS + 1 if again else 1)
        if simulation.num_robots > 1 and not math.isnan(row["min_separation"]):
            assert (row["collisions"] > 0) == (row["min_separation"] < 2 * scenario.robot.radius)
        formation = [value for name, value in row.items() if name.startswith(FORMATION)]
        assert scenario.has_formation or np.isnan(formation).all()
        assert not row["phase_error"] > math.pi + 1e-6
        assert row["distance_mean"] <= 1.01 * row["speed_max"] * duration + 1e-4 or scenario.robot.kind == "curve"
        if scenario.robot.kind == "curve" or scenario.task.boundary == "wall":
            assert row["outside_time"] == 0
        # The nearest point of the curve is no farther than that of the robot's own phase.
        for part in ("mean", "max"):
            assert not row[f"lateral_error_{part}"] > 1.001 * row[f"tracking_error_{part}"] + 0.01 * longest
    detected = simulation.targets.found_at.numpy() < NEVER
    early = simulation.targets.found_early.numpy()
    assert ((early >= 0) & (early <= 1)).all()
    assert (early[~detected] == 0).all()
    waited = simulation.targets.found_at.numpy() - simulation.targets.appears_at.numpy()
    assert (early <= waited)[detected].all(), "nobody is seen before being there"
    cells = math.prod(scenario.task.grid or (0,))
    assert (simulation.tally.covered.numpy() <= cells).all()
    assert (simulation.tally.covered_each.numpy() <= cells * simulation.num_robots).all()
