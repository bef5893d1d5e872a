"""Environments, pictures and recordings in the hands of strangers: what they pass in, and how large it is."""

import resource
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

import lissajous_env
from lissajous_env.render import Renderer, Snapshot
from tests.adversarial import Attack, held_back

_SCENARIOS = ("experiment", "failure", "intruders", "rough")
_ODD = (
    None, True, 0, -1, 2**63, 10**400, 1.5, 1e300, -1e300, float("nan"), float("inf"), 1j, "a", b"a", "", [], {}, (),
    [[]], [1, [2, 3]], {"robot_0": 1}, object(), np.array(["a"]), np.array([None]), np.zeros((0, 2)),
    np.zeros((5, 2, 1)), np.full((5, 2), np.nan), np.full(2, np.inf), np.ones(2, complex), np.ones(2, np.int8),
    np.ma.masked, range(2),
)  # fmt: skip
_ROOM = 700 * 1024
"""Memory that one try may take more than those before it [KiB]."""


def _odd(draw: np.random.Generator) -> Any:
    return _ODD[draw.integers(len(_ODD))]


def _name(draw: np.random.Generator) -> str:
    return str(draw.choice(_SCENARIOS))


def _bounded(call: Callable[[], str | None]) -> str | None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    seen = call()
    taken = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return f"took {taken // 1024} MiB" if seen is None and taken > _ROOM else seen


def _refused_or_fine(call: Callable[[], object]) -> str | None:
    """None where a call runs clean, raises a clear ValueError, or says that a reset is due."""
    try:
        return held_back(call)
    except gymnasium.error.ResetNeeded:
        return None


def _hostile_step(draw: np.random.Generator) -> str | None:
    made = {"discrete_actions": bool(draw.integers(2)), "max_cycles": 20}
    kind = draw.integers(4)
    if kind == 0:
        env: Any = lissajous_env.parallel_env(_name(draw), **made)
    elif kind == 1:
        env = lissajous_env.LissajousEnv(_name(draw), flat_actions=bool(draw.integers(2)), **made)
    else:
        env = lissajous_env.vector_env(
            _name(draw), 2, flat_actions=bool(draw.integers(2)), agents_as_rows=kind == 3, **made
        )
    env.reset(seed=int(draw.integers(1000)))
    simulation = env.simulation
    for _ in range(8):
        before = simulation.save_state()
        action = _odd(draw)
        if kind == 0 and draw.random() < 0.8:
            action = {agent: env.action_space(agent).sample() for agent in env.agents}
            where = draw.choice([*env.agents, "robot_99"])
            action[where] = _odd(draw)
        elif kind != 0 and draw.random() < 0.5:
            action = np.asarray(env.action_space.sample(), dtype=float)
            action.reshape(-1)[draw.integers(action.size)] = draw.choice([np.nan, np.inf, -1e30, 7.0])
        moved = simulation.clock.step.numpy().copy()
        seen = _refused_or_fine(lambda action=action: env.step(action))
        if seen is not None:
            return f"{type(env).__name__}.step({action!r}): {seen}"
        if not np.isfinite(simulation.observation.numpy()).all():
            return f"an observation is not finite after {action!r}"
        if (simulation.clock.step.numpy() == moved).all():
            after = simulation.save_state()
            changed = [name for name in before if before[name].tobytes() != after[name].tobytes()]
            if changed:
                return f"{action!r} was refused but changed {changed}"
    return None


def _picture(draw: np.random.Generator) -> str | None:
    radius = float(10.0 ** draw.uniform(-3, 6))
    overrides: dict[str, Any] = {"sensing.radius": radius}
    name = str(draw.choice(["experiment", "failure", "knot", "swarm"]))
    if name in ("failure", "knot") and draw.random() < 0.5:
        a = 2 * int(draw.integers(1, 512)) + 1
        overrides |= {"curve.a": a, "curve.b": a + 1, "robot.count": 5}
    if draw.random() < 0.3:
        overrides["task.grid"] = tuple(int(cells) for cells in draw.integers(1, 4097, 2))
    if draw.random() < 0.3:
        overrides["targets.count"] = int(10 ** draw.uniform(0, 5.5))
    if draw.random() < 0.3:
        overrides |= {
            "curve.half_width": float(10 ** draw.uniform(-2, 3)),
            "robot.radius": float(draw.uniform(0.01, 9)),
        }
    size = None if draw.random() < 0.5 else tuple(int(side) for side in draw.integers(100, 1200, 2))

    def attempt() -> None:
        simulation = lissajous_env.Simulation(lissajous_env.scenario(name, **overrides), seed=int(draw.integers(99)))
        picture = Renderer(simulation.scenario, size).draw(simulation)
        assert picture.std() > 1, "an empty picture"

    seen = _bounded(lambda: held_back(attempt))
    return None if seen is None else f"{name} {overrides} {size}: {seen}"


_FAR_WORLD: list[Any] = []


def _positions(draw: np.random.Generator) -> str | None:
    import dataclasses

    if not _FAR_WORLD:
        simulation = lissajous_env.Simulation("experiment", seed=1)
        _FAR_WORLD.extend([Renderer("experiment"), Snapshot.of(simulation)])
    renderer, seen = _FAR_WORLD

    def far(shape: tuple[int, ...]) -> np.ndarray:
        size = np.where(draw.random(shape) < 0.5, 1.0, 10.0 ** draw.uniform(-30, 38, shape))
        return (draw.uniform(-1, 1, shape) * size).astype(np.float32)

    steps = int(draw.integers(1, 200))
    changed = dataclasses.replace(
        seen,
        step=steps,
        position=far((5, 3)),
        heading=far((5,)),
        status=draw.integers(0, 3, 5),
        target_position=far(seen.target_position.shape),
        found_at=draw.integers(0, 2**30, len(seen.found_at)),
        sensed_at=draw.integers(-(2**30), 2**30, seen.sensed_at.shape).astype(np.int32),
        contact=draw.integers(0, 5, (int(draw.integers(0, 20)), 2)),
        trail=(np.arange(steps + 1), far((steps + 1, 5, 2))) if draw.random() < 0.7 else None,
    )
    return _bounded(lambda: None if renderer.draw(changed).std() > 5 else "an empty picture")


ATTACKS = [
    Attack(
        "hostile actions",
        "A step runs without NaN, or is rejected in one line and does not change the state.",
        150,
        _hostile_step,
    ),
    Attack("sizes of pictures", "A picture is drawn in bounded memory, or a setting is rejected.", 60, _picture),
    Attack("positions in pictures", "Objects at any position can be drawn.", 200, _positions),
]
