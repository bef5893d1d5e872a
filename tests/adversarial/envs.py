"""Environments, pictures and recordings in the hands of strangers: what they pass in, and how large it is."""

import copy
import io
import json
import pickle
import resource
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import lissajous_env
from lissajous_env.episodes import recording
from lissajous_env.render import Renderer, Snapshot, film
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


def _hostile_reset(draw: np.random.Generator) -> str | None:
    env: Any = [
        lambda: lissajous_env.parallel_env(_name(draw)),
        lambda: lissajous_env.LissajousEnv(_name(draw)),
        lambda: lissajous_env.vector_env(_name(draw), 2, agents_as_rows=bool(draw.integers(2))),
    ][draw.integers(3)]()
    for _ in range(6):
        seed, options = _odd(draw), _odd(draw)
        if draw.random() < 0.5:
            options = {"reset_mask": _odd(draw)}
        seen = _refused_or_fine(lambda seed=seed, options=options: env.reset(seed=seed, options=options))
        if seen is not None:
            return f"{type(env).__name__}.reset(seed={seed!r}, options={options!r}): {seen}"
    return None


def _hostile_keywords(draw: np.random.Generator) -> str | None:
    keys = (
        "max_cycles", "render_mode", "num_envs", "autoreset_mode", "scenario", "name", "self", "curve", "curve.a",
        "curve.", ".", "", "task.grid", "faults.schedule", "frameskip", "threads", "device", "robot",
    )  # fmt: skip
    key, value = str(draw.choice(keys)), _odd(draw)
    maker = [lissajous_env.parallel_env, lissajous_env.env, lissajous_env.LissajousEnv, lissajous_env.vector_env]
    made = maker[draw.integers(4)]
    try:
        return held_back(lambda: made(**{key: value}))
    except TypeError as error:  # Python's own, for what is given twice
        return None if "argument" in str(error) else f"{made.__name__}({key}={value!r}): TypeError: {error}"


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


_KEPT: list[recording.Recording] = []


class _Still:
    num_worlds = 1

    def reset(self, worlds: Any = None) -> None:
        pass

    def act(self, observation: Any) -> np.ndarray:
        return np.zeros((1, 5, 2), np.float32)


def _kept() -> recording.Recording:
    if not _KEPT:
        _KEPT.append(recording.record(_Still(), lissajous_env.scenario("experiment", **{"task.duration": 0.5}), seed=1))
    return _KEPT[0]


def _recording_file(draw: np.random.Generator) -> str | None:
    """Change a field of what it says, a header, or bytes; it is refused by name, or can be drawn."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "kept.npz"
        _kept().save(path)
        with zipfile.ZipFile(path) as file:
            raw = {name: file.read(name) for name in file.namelist()}
        kind = draw.integers(4)
        if kind == 0:
            about = json.loads(str(np.load(io.BytesIO(raw["about.npy"]))))
            parts = [
                about,
                about["score"],
                about["scenario"],
                *(v for v in about["scenario"].values() if v and type(v) is dict),
            ]
            target = parts[draw.integers(len(parts))]
            values = (
                None,
                True,
                -1,
                0,
                10**9 + 1,
                1e300,
                10**400,
                1e-300,
                float("nan"),
                float("inf"),
                "x",
                [],
                {},
                [[1]],
                2**31,
            )
            target[str(draw.choice(list(target)))] = values[draw.integers(len(values))]
            words = io.BytesIO()
            np.save(words, np.array(json.dumps(about)))
            raw["about.npy"] = words.getvalue()
        elif kind == 1:
            name = str(draw.choice(list(recording.ARRAYS)))
            claim = io.BytesIO()
            shape = tuple(int(10 ** draw.uniform(0, 12)) for _ in range(draw.integers(0, 4)))
            descr = str(draw.choice(["<f4", "<f8", "<i4", "|O", "<U9", "<c16", "|i1"]))
            np.lib.format.write_array_header_1_0(claim, {"descr": descr, "fortran_order": False, "shape": shape})
            raw[f"{name}.npy"] = claim.getvalue() + bytes(int(draw.integers(0, 10**6)))
        elif kind == 3:
            far = io.BytesIO()
            np.save(far, (_kept().position * 10.0 ** draw.uniform(0, 38)).astype(np.float32))
            raw["position.npy"] = far.getvalue()
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
            for name, data in raw.items():
                file.writestr(name, data)
        if kind == 2:
            data = bytearray(path.read_bytes())
            for at in draw.integers(0, len(data), int(draw.integers(1, 9))):
                data[at] = draw.integers(256)
            path.write_bytes(data[: int(draw.integers(1, len(data) + 1))] if draw.random() < 0.3 else data)

        def attempt() -> None:
            try:
                loaded = recording.load(path)
            except ValueError as error:
                if "kept.npz" not in str(error):
                    raise RuntimeError("the file is not named") from error
                raise
            assert next(film.frames(loaded)).std() > 1, "an empty picture"

        return _bounded(lambda: held_back(attempt))


def _copied(draw: np.random.Generator) -> str | None:
    name, kind = _name(draw), draw.integers(3)
    settings: dict[str, Any] = {"task.on_collision": str(draw.choice(["count", "remove"])), "max_cycles": 25}
    env: Any = [
        lambda: lissajous_env.LissajousEnv(name, **settings),
        lambda: lissajous_env.vector_env(name, 3, autoreset_mode="SAME_STEP", **settings),
        lambda: lissajous_env.vector_env(name, 3, agents_as_rows=True, **settings),
    ][kind]()
    env.reset()
    env.action_space.seed(int(draw.integers(1000)))
    twin = None
    at = int(draw.integers(0, 20))
    for step in range(24):
        if step == at:
            twin = copy.deepcopy(env) if draw.random() < 0.5 else pickle.loads(pickle.dumps(env))
        action = env.action_space.sample()
        expected = env.step(action)
        if twin is not None and str(twin.step(action)) != str(expected):
            return f"a copy of {type(env).__name__} at step {at} went its own way at step {step}"
        if kind == 0 and (expected[2] or expected[3]):
            break
    return None


def _seeds(draw: np.random.Generator) -> str | None:
    """Test that episodes differ without a seed, and are the same with one."""
    name, seed = str(draw.choice(["intruders", "rough"])), int(draw.integers(2**40))
    made: list[Any] = [
        lissajous_env.LissajousEnv(name),
        gymnasium.make(f"lissajous/{name}-v0"),
        lissajous_env.vector_env(name, 1),
        lissajous_env.vector_env(name, 1, agents_as_rows=True),
    ]
    free = [np.asarray(env.reset()[0]).tobytes() for env in made]
    parallel = lissajous_env.parallel_env(name)
    free.append(np.stack(list(parallel.reset()[0].values())).tobytes())
    seeded = [np.asarray(env.reset(seed=seed)[0]).tobytes() for env in made]
    seeded.append(np.stack(list(parallel.reset(seed=seed)[0].values())).tobytes())
    if len(set(free)) < len(free):
        return f"two environments of {name} began alike without a seed"
    return None if len(set(seeded)) == 1 else f"{name} with seed {seed} began in {len(set(seeded))} ways"


ATTACKS = [
    Attack(
        "hostile actions",
        "A step runs without NaN, or is rejected in one line and does not change the state.",
        150,
        _hostile_step,
    ),
    Attack("hostile resets", "Seeds and options are accepted, or rejected in one line.", 150, _hostile_reset),
    Attack(
        "hostile keywords", "An environment is created, or a keyword is rejected in one line.", 200, _hostile_keywords
    ),
    Attack("sizes of pictures", "A picture is drawn in bounded memory, or a setting is rejected.", 60, _picture),
    Attack("positions in pictures", "Objects at any position can be drawn.", 200, _positions),
    Attack("files of recordings", "A changed file is rejected by its name, or can be drawn.", 150, _recording_file),
    Attack("copies of environments", "A copy in mid-episode continues like the original, bit for bit.", 60, _copied),
    Attack("episodes without a seed", "Episodes differ; with the same seed they are the same.", 40, _seeds),
]
