"""Attacks on the world: strange fields, actions and resets, after which its documented properties must still be
true."""

import dataclasses
import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import lissajous_env
from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.world.columns import COLUMNS
from tests.adversarial import Attack, held_back

FIELDS = [(part, field) for part, kind in PARTS.items() for field in dataclasses.fields(kind)]
BASES = ("experiment", "intruders", "rough", "failure", "knot", "perturbation")
CROWD = {"curve.a": 51, "curve.b": 50, "sensing.radius": 0.4, "formation.phase_rate": 0.02, "targets.count": 60}
"""A hundred robots: `swarm`, small enough for moments."""
_MAY_BE_NAN = {each.name for each in COLUMNS.values() if each.empty}
_STRANGE: tuple[Any, ...] = (
    None, True, False, "", "1", "nan", b"1", 1j, object, (), [], (0,), ((0, 1),), ((0, 1, 2),), ((1.0, 0.2),), {},
    math.nan, math.inf, -math.inf, 0, 0.0, -0.0, 10**30, -(10**30), 10**400, 2**31, 2**32 + 3, np.float32(2), np.nan,
    ((0, 1e10, 1e11),), ((0, 1.0, math.inf),), ((0, math.nan, 1),), ((-1, 0, 1),), ((2**70, 1, 2),), (1, 1), (4096, 1),
    np.array([1.0, np.nan]), np.ones((2, 2)), "open", "wall", "remove", "stop", "curve", "car", "random", "boundary",
    "unseen",
)  # fmt: skip


# Fields.


def any_value(draw: np.random.Generator, field: dataclasses.Field) -> Any:
    """A value of any size and kind, or one inside the field's range, its ends among them."""
    kind = draw.integers(4)
    ends = re.search(r"from (\S+) to (\S+)", field.metadata["rule"])
    if kind == 0:
        return _STRANGE[draw.integers(len(_STRANGE))]
    if kind == 1 or ends is None:
        value = float(draw.choice([-1, 1]) * 10 ** draw.uniform(-300, 300))
        return int(value) if draw.random() < 0.2 else value
    return within_range(draw, field)


def within_range(draw: np.random.Generator, field: dataclasses.Field) -> Any:
    """A value inside the range that the rule of a field names, of any order of magnitude; else its default."""
    rule = field.metadata["rule"]
    ends = re.search(r"from (\S+) to (\S+)", rule)
    if ends is None or not rule.startswith("must be") or "(columns" in rule:
        return field.default
    low, high = float(ends[1]), float(ends[2])
    if draw.random() < 0.2:
        value = low if draw.random() < 0.5 else high
    elif low < 0:
        value = draw.uniform(low, high)
    else:
        least = max(low, 1e-6 * high)
        value = least * (high / least) ** draw.random()
    return round(value) if "whole" in rule else float(min(max(value, low), high))


def any_fields(draw: np.random.Generator) -> dict[str, Any]:
    """Overrides of one to three fields with any values, or of many with values inside their ranges."""
    if draw.random() < 0.3:
        picked = draw.choice(len(FIELDS), draw.integers(3, 12), replace=False)
        return {f"{FIELDS[k][0]}.{FIELDS[k][1].name}": within_range(draw, FIELDS[k][1]) for k in picked}
    picked = draw.choice(len(FIELDS), draw.integers(1, 4), replace=False)
    return {f"{FIELDS[k][0]}.{FIELDS[k][1].name}": any_value(draw, FIELDS[k][1]) for k in picked}


def fields(draw: np.random.Generator) -> str | None:
    """Make a scenario of any fields, and run what is not refused."""
    overrides, base = any_fields(draw), str(draw.choice(BASES))
    seen: list[str | None] = []
    refused = held_back(lambda: seen.append(run_clean(lissajous_env.scenario(base, **overrides), draw)))
    words = refused or (seen[0] if seen else None)
    return None if words is None else f"{base} with {overrides}: {words}"


def run_clean(scenario: Scenario, draw: np.random.Generator, steps: int = 8) -> str | None:
    """Step one or two worlds with random and extreme actions: what is not finite or in its range, None for nothing."""
    work = scenario.num_robots * (math.prod(scenario.task.grid or (0,)) + scenario.target_capacity)
    if work > 3e7:
        return None  # possible, but seconds a step
    simulation = lissajous_env.Simulation(scenario, int(draw.integers(1, 3)), seed=int(draw.integers(2**31 - 2)))
    for _ in range(min(steps, max(int(3e7 // (work + 1)), 1))):
        simulation.step(extreme_action(draw, simulation.action_shape))
        words = out_of_range(simulation)
        if words is not None:
            return f"after step {simulation.clock.step.numpy()[0]}: {words}"
    simulation.reset()
    return out_of_range(simulation)


def extreme_action(draw: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Actions in and out of [-1, 1], at its ends, and what is no number."""
    kind = draw.integers(4)
    if kind == 0:
        return draw.choice([-1.0, 1.0], shape).astype(np.float32)
    if kind == 1:
        return draw.choice([np.nan, np.inf, -np.inf, 1e300, -1e-300, 0.5], shape)
    return draw.uniform(-1.5, 1.5, shape).astype(np.float32)


def out_of_range(simulation: Any) -> str | None:
    """Return the arrays and scores of a simulation that are not finite, or not in the documented range; None for
    none."""
    rows = simulation.observation.numpy()
    if not (
        np.isfinite(rows).all() and (rows >= simulation.layout.low).all() and (rows <= simulation.layout.high).all()
    ):
        names = np.array(simulation.layout.names)
        bad = ~np.isfinite(rows) | (rows < simulation.layout.low) | (rows > simulation.layout.high)
        return f"observation of {', '.join(sorted(set(names[np.nonzero(bad)[2]])))}: {rows[bad][:3]}"
    robots, targets = simulation.robots, simulation.targets
    arrays = {"reward": simulation.reward, "terms": simulation.reward_terms, "position": robots.position}
    arrays |= {"heading": robots.heading, "speed": robots.speed, "phase": robots.phase, "targets": targets.position}
    for name, array in arrays.items():
        if not np.isfinite(array.numpy()).all():
            return f"{name} is not finite"
    for row in simulation.score():
        for name, value in row.items():
            if isinstance(value, float) and not (math.isfinite(value) or (math.isnan(value) and name in _MAY_BE_NAN)):
                return f"score {name} is {value}"
    return None


# Actions and resets.


def actions(draw: np.random.Generator) -> str | None:
    """Step with what is no action: refused, and nothing has moved."""
    simulation = lissajous_env.Simulation("experiment", 2, seed=int(draw.integers(1000)))
    shape = simulation.action_shape
    wrong = [
        None, 1.0, "left", object(), [], {}, np.zeros(shape[1:]), np.zeros((*shape, 1)), np.zeros((3, 5, 2)),
        np.zeros(shape, dtype=object), np.zeros(shape, dtype=bool), np.zeros(shape, dtype=complex),
        np.full(shape, "a"), np.zeros(shape, dtype="M8[s]"), [[[0.0, 0.0]] * 5, [[0.0]] * 5],
        wp.zeros(shape, dtype=wp.int32), wp.zeros(shape, dtype=wp.float64), wp.zeros((2, 5), dtype=wp.vec2),
    ]  # fmt: skip
    action = wrong[draw.integers(len(wrong))]
    return _refused_untouched(simulation, lambda: simulation.step(action), f"action {action!r:.80}")


def resets(draw: np.random.Generator) -> str | None:
    """Reset with what are no worlds and no seeds: refused, and nothing has moved."""
    simulation = lissajous_env.Simulation("failure", 3, seed=int(draw.integers(1000)))
    wrong: list[tuple[Any, Any]] = [
        ([0.9], None), ("all", None), ([[0, 1]], None), ([0, 0], None), ([-1], None), ([3], None), ([None], None),
        ([True], None), ([2**70], None), ([[0], [1, 2]], None), (1.0, None), (None, [1, 2]), (None, [1.0, 2.0, 3.0]),
        (None, [True, False, True]), (None, "abc"), (None, [-1, 0, 1]), (None, [2**31, 0, 1]), ([0], [[1]]),
        ([0], None if draw.random() < 0 else [1, 2]), (None, 10**30), (None, math.nan),
    ]  # fmt: skip
    worlds, seeds = wrong[draw.integers(len(wrong))]
    return _refused_untouched(
        simulation, lambda: simulation.reset(worlds, seeds), f"worlds {worlds!r}, seeds {seeds!r}"
    )


def _refused_untouched(simulation: Any, call: Any, what: str) -> str | None:
    before = simulation.save_state()
    try:
        call()
    except ValueError:
        after = simulation.save_state()
        changed = [name for name in before if before[name].tobytes() != after[name].tobytes()]
        return f"{what} changed {changed}" if changed else None
    return f"{what} was taken"


# The world of the promises.


def any_scenario(draw: np.random.Generator) -> Scenario:
    """A scenario with a few fields inside their ranges that runs in moments; a third are of many robots, with bins."""
    if draw.random() < 1 / 3:
        return any_crowd(draw)
    while True:
        picked = draw.choice(len(FIELDS), draw.integers(1, 6), replace=False)
        overrides = {f"{FIELDS[k][0]}.{FIELDS[k][1].name}": within_range(draw, FIELDS[k][1]) for k in picked}
        edge = {"task.boundary": str(draw.choice(["open", "wall", "remove"]))}
        try:
            scenario = lissajous_env.scenario(str(draw.choice(BASES)), **(edge | overrides))
        except ValueError:
            continue
        if scenario.num_robots * (math.prod(scenario.task.grid or (0,)) + scenario.target_capacity) < 1e5:
            return scenario


def any_crowd(draw: np.random.Generator) -> Scenario:
    """A scenario of a hundred robots, many of which collide."""
    overrides = CROWD | {
        "robot.radius": float(draw.uniform(0.05, 0.25)), "formation.phase_rate": float(10 ** draw.uniform(-4, -1)),
        "sensing.radius": float(draw.uniform(0.1, 1.0)), "targets.fleeing": float(draw.uniform(0, 1)),
        "targets.wandering": 0.0, "targets.arrival_rate": float(draw.choice([0.0, 20.0])),
        "targets.entry": str(draw.choice(["inside", "boundary", "unseen"])),
        "task.on_collision": str(draw.choice(["count", "stop", "remove"])),
        "task.boundary": str(draw.choice(["open", "wall", "remove"])),
        "faults.rate": float(draw.choice([0.0, 0.3])), "task.duration": 3.0,
    }  # fmt: skip
    return lissajous_env.scenario("swarm", **overrides)


def batch_law(draw: np.random.Generator) -> str | None:
    """World k alone is world k of a batch, bit for bit."""
    scenario, worlds, seed = any_scenario(draw), int(draw.integers(2, 6)), int(draw.integers(1000))
    k = int(draw.integers(worlds))
    batch = lissajous_env.Simulation(scenario, worlds, seed=seed)
    alone = lissajous_env.Simulation(scenario, 1, seed=seed + k)
    for _ in range(15):
        action = draw.uniform(-1.3, 1.3, batch.action_shape).astype(np.float32)
        batch.step(action)
        alone.step(action[[k]])
        for name in ("observation", "reward_terms", "terminated"):
            if getattr(alone, name).numpy()[0].tobytes() != getattr(batch, name).numpy()[k].tobytes():
                return f"{name} of world {k} of {worlds} differs in {scenario}"
    if str(alone.score()) != str(batch.score([k])):
        return f"the score of world {k} of {worlds} differs in {scenario}"
    return None


def history_law(draw: np.random.Generator) -> str | None:
    """A world is the same after any other episode, any content of its memory, and a state that was loaded."""
    scenario, seed = any_scenario(draw), int(draw.integers(1000))
    fresh, used = (lissajous_env.Simulation(scenario, 1) for _ in range(2))
    shape = fresh.action_shape

    def play(simulation: lissajous_env.Simulation, seed: int | None, actions: np.ndarray) -> list[bytes]:
        if seed is not None:
            simulation.reset(seeds=[seed])
        shown = [simulation.observation.numpy().tobytes()]
        for action in actions:
            simulation.step(action[None])
            shown += [getattr(simulation, name).numpy().tobytes() for name in ("observation", "reward_terms")]
        return [*shown, str(simulation.score()).encode()]

    actions = draw.uniform(-1.3, 1.3, (12, *shape[1:])).astype(np.float32)
    play(used, seed, actions[: int(draw.integers(12))])
    if draw.random() < 0.5:
        for array in used._groups().values():
            content = array.numpy()
            content[...] = np.array(draw.choice([-1, 1, 77_777])).astype(content.dtype)
    expected = play(fresh, seed, actions)
    if play(used, seed, actions) != expected:
        return f"seed {seed} differs after another episode in {scenario}"
    play(fresh, seed, actions[:5])
    play(used, seed + 1, actions[: int(draw.integers(5, 8))])
    used.load_state(fresh.save_state())
    if play(used, None, actions[5:]) != play(fresh, None, actions[5:]):
        return f"seed {seed} goes on otherwise where its state was loaded, in {scenario}"
    return None


def independent_reference(draw: np.random.Generator) -> str | None:
    """Against the float64 model of the tests: who works, what collides, leaves and is found, and the score."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    import reference
    import reference_driving

    overrides = {
        "targets.turn_rate": 0.0, "sensing.radius": float(draw.uniform(0.3, 0.9)),
        "robot.radius": float(draw.uniform(0.03, 0.15)), "task.boundary": str(draw.choice(["open", "wall", "remove"])),
        "task.on_collision": str(draw.choice(["count", "stop", "remove"])), "faults.schedule": ((0, 1.0, 2.0),),
        "task.reward_outside": -1.0,
    }  # fmt: skip
    scenario = lissajous_env.scenario(str(draw.choice(["experiment", "failure"])), **overrides)
    seed = int(draw.integers(10_000))
    simulation = lissajous_env.Simulation(scenario, seed=seed)
    world = reference.world_like(simulation)
    for action in reference_driving.smooth_actions(simulation.action_shape[1:], 60, seed):
        simulation.step(action[None])
        world.step(action)
    expected, got = world.score(), simulation.score()[0]
    for name, value in expected.items():
        if not np.isclose(got[name], value, atol=2e-3, rtol=5e-3, equal_nan=True):
            return f"{name} is {got[name]}, not {value}, with seed {seed} and {overrides}"
    return None


def overflow(draw: np.random.Generator) -> str | None:
    """Sums far beyond 32 bits continue exactly."""
    # All five touch from the start, in each of ten pairs and in every step.
    crowd = {"robot.radius": 900.0, "formation.start": "equilibrium", "task.reward_waiting": -1.0, "targets.count": 3}
    overrides = crowd | {"sensing.radius": 1e-6, "targets.arrival_rate": 0.0, "faults.schedule": ()}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure", **overrides))
    large, steps = int(draw.integers(2**31 - 20, 2**45)), int(draw.integers(1, 20))
    simulation.tally.contact_steps.fill_(large)
    simulation.tally.returns.fill_(2.0**31)
    for _ in range(steps):
        simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))
    contact = int(simulation.tally.contact_steps.numpy()[0]) - large
    earned = float(simulation.tally.returns.numpy()[0, 1]) - 2.0**31
    collided = -4.0  # with four others, once each
    if contact != 10 * steps or abs(earned - collided + 0.3 * steps) > 1e-4:
        return f"{steps} steps after {large}: {contact} pairs in contact, {earned} earned"
    return None


def extensions(draw: np.random.Generator) -> str | None:
    """Bring numbers of any size, and write to what is given: refused by name, or all that a step returns is finite."""
    weight, value = (float(draw.choice([-1, 1]) * 10 ** draw.uniform(-45, 45)) for _ in range(2))
    value = float(draw.choice([value, value, math.nan, math.inf]))
    meddles = draw.random() < 0.3
    part, others = ("robots", "position heading speed phase"), ("targets", "position heading in_sight")
    name, fields = part if draw.random() < 0.5 else others
    field = str(draw.choice(fields.split()))

    def wild(world: Any) -> Any:
        if meddles:
            getattr(getattr(world, name), field)[...] = 0
        return np.where(draw.random((1, 5)) < 0.2, value, 1.0)

    seen: list[str | None] = []

    def play() -> None:
        kinds = [lissajous_env.reward_term(weight), lissajous_env.observation_entry()]
        brought = kinds[draw.integers(len(kinds))](wild)
        simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", extensions=[brought]))
        for _ in range(5):
            simulation.step(draw.uniform(-1, 1, simulation.action_shape))
            seen.append(out_of_range(simulation))
        if meddles:
            seen.append("what was written was taken")

    refused = held_back(play)
    words = refused or next((each for each in seen if each), None)
    return None if words is None else f"{value} times {weight}, meddles with {name}.{field} is {meddles}: {words}"


def conservative(draw: np.random.Generator) -> str | None:
    """A rogue in a gap of a formation that moves as a whole, against the conservative figure."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "world"))
    import test_conservative

    lissajous_env.register_robot_model(test_conservative.CONVOY)
    angle, columns = float(draw.uniform(0, 2 * np.pi)), int(draw.integers(20, 90))
    grid, step = (columns, round(columns * draw.uniform(0.7, 1.0))), float(draw.choice([0.02, 0.05, 0.1, 0.3]))
    gap = float(10 ** draw.uniform(-3, 0)) * 2 * test_conservative.HALF / columns
    unseen, figure = test_conservative.unseen_behind_a_convoy(angle, step, grid, gap)
    if figure >= unseen - 1e-9:
        return None
    return f"{unseen:.2f} s unseen, the figure is {figure:.2f} s, at {angle} rad, steps of {step} s, on {grid}"


ATTACKS = [
    Attack(
        "any value in any field",
        "A scenario runs with finite results, or a ValueError of one line is raised.",
        400,
        fields,
    ),
    Attack("what is no action", "The input is rejected, and the state does not change.", 60, actions),
    Attack("what are no worlds or seeds", "The input is rejected, and the state does not change.", 60, resets),
    Attack("a world alone and in a batch", "The results are the same, bit for bit.", 60, batch_law),
    Attack("a world with a past", "The results are the same, bit for bit.", 60, history_law),
    Attack("an independent model of the world", "Both compute the same score.", 40, independent_reference),
    Attack(
        "hostile extensions",
        "An extension is rejected by name, or its results are finite and it does not change the state.",
        150,
        extensions,
    ),
    Attack("rogues in a moving gap", "No rogue stays undetected for longer than the proved bound.", 30, conservative),
    Attack("sums beyond 32 bits", "The sums are exact.", 30, overflow),
]
