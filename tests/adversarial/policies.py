"""Attacks on policies: batches, copies, actions and observations that are no numbers, networks of all shapes."""

import copy
import pickle
import tempfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from rich.console import Console

import baselines
import lissajous_env
from baselines.benchmark.running import measure
from baselines.benchmark.types import Benchmark
from baselines.policies.base import Policy
from lissajous_env import Simulation
from lissajous_env.episodes.evaluation import evaluate
from lissajous_env.episodes.recording import record
from tests.adversarial import Attack
from training.learned.card import Card
from training.learned.network import Network
from training.learned.policy import Learned

SCENARIOS = ("experiment", "rough", "intruders", "failure", "knot", "perturbation")
CAR_INPUTS = 42


def drawn_policy(draw: np.random.Generator) -> tuple[str, str]:
    """Name of a scenario, and of a policy that drives its robots."""
    scenario = str(draw.choice(SCENARIOS))
    while True:
        name = str(draw.choice(baselines.names(scenario)))
        try:
            baselines.make(name, scenario)
        except ValueError:  # a learned policy whose observation is another
            continue
        return scenario, name


def in_any_batch(draw: np.random.Generator) -> str | None:
    """A row among 33 worlds, and in a batch of another size, order and make of array."""
    scenario, name = drawn_policy(draw)
    simulation = Simulation(scenario, 33, seed=int(draw.integers(2**30)))
    size = int(draw.choice([1, 2, 3, 5, 16, 33, 40]))
    worlds = draw.integers(0, 33, size)
    together, apart = baselines.make(name, scenario, 33), baselines.make(name, scenario, size)
    as_warp = bool(draw.integers(2))
    for step in range(int(draw.integers(3, 15))):
        rows = simulation.observation.numpy().copy()
        action = together.act(rows)
        own = np.ascontiguousarray(rows[worlds])
        got = apart.act(wp.array(own, dtype=wp.float32, device="cpu")).numpy() if as_warp else apart.act(own)
        if not (got == action[worlds]).all():
            return f"{name} on {scenario}, batch of {size}: step {step} differs"
        simulation.step(action)
        if draw.random() < 0.2:
            forgotten = draw.random(33) < 0.3
            together.reset(forgotten)
            apart.reset(forgotten[worlds])
    return None


def copied(draw: np.random.Generator) -> str | None:
    """A deep copy, a pickle and a loaded state, at any step."""
    scenario, name = drawn_policy(draw)
    worlds = int(draw.integers(1, 5))
    policy, simulation = (
        baselines.make(name, scenario, worlds),
        Simulation(scenario, worlds, seed=int(draw.integers(99))),
    )
    for _ in range(int(draw.integers(0, 25))):
        simulation.step(policy.act(simulation.observation))
    loaded = baselines.make(name, scenario, worlds)
    loaded.load_state(policy.save_state())
    copies = {"deepcopy": copy.deepcopy(policy), "pickle": pickle.loads(pickle.dumps(policy)), "state": loaded}
    for step in range(6):
        rows = simulation.observation.numpy().copy()
        action = policy.act(rows)
        for way, each in copies.items():
            if not (each.act(rows) == action).all():
                return f"{name} on {scenario}, by {way}: step {step} differs"
        simulation.step(action)
    return None


class Wrecked(Policy):
    """Another policy until a step, in which one number of its action is replaced."""

    arrays = "warp"

    def __init__(self, policy: Policy, step: int, place: tuple[int, int, int], value: float):
        super().__init__(policy.scenario, policy.num_worlds)
        self.policy, self.step, self.place, self.value, self.now = policy, step, place, value, 0
        self.name = "wrecked"

    def forget(self, mask: np.ndarray) -> None:
        """Begin to count again."""
        self.policy.reset(mask)
        self.now = 0

    def decide(self, observation: wp.array) -> None:
        """Take the other's action, and replace the number."""
        self.now += 1
        action = self.policy.act(observation).numpy().copy()
        if self.now == self.step:
            action[self.place] = self.value
        self.action.assign(action)


def not_a_number(draw: np.random.Generator) -> str | None:
    """One number of one action in an episode, through evaluate, record and a benchmark."""
    scenario, name = drawn_policy(draw)
    made = lissajous_env.scenario(scenario, **{"task.duration": 2.0, "task.grid": None})
    inner = baselines.make(name, made, 3)
    steps = made.resolve().task.steps
    step, way = int(draw.integers(1, steps + 1)), int(draw.integers(3))
    world = 0 if way == 1 else int(draw.integers(3))
    place = (world, int(draw.integers(made.num_robots)), int(draw.integers(inner.action.shape[2])))
    wrecked = Wrecked(inner, step, place, float(draw.choice([np.nan, np.inf, -np.inf])))
    where = f"step {step} of {scenario} in world {world} "
    words = f"policy wrecked must return finite actions, got NaN or infinity in {where}"
    try:
        if way == 0:
            evaluate(wrecked, made, range(3))
        elif way == 1:
            record(wrecked, made)
        else:
            with tempfile.TemporaryDirectory() as folder:
                settings = Benchmark((scenario,), ("still",), 3, batch=3, out=Path(folder))
                outcome = measure(settings, {"wrecked": wrecked}, [made], Console(quiet=True))
            if {row["policy"] for row in outcome.rows} != {"still"}:
                return "its rows were kept"
            raise ValueError(outcome.failures[0].error.partition(": ")[2])
    except ValueError as error:
        return None if str(error).startswith(words) else f"{way}: {error}"
    return f"{way}: it was scored"


def hostile_rows(draw: np.random.Generator) -> str | None:
    """Observations of absurd sizes, not finite, of another type or shape."""
    scenario, name = drawn_policy(draw)
    policy = baselines.make(name, scenario, 2)
    rows: Any = draw.uniform(-1, 1, policy.observation_shape)
    scale = draw.choice([1.0, 10.0, 1e6, 1e30, 3e38, 1e300, np.nan, np.inf, -np.inf])
    with np.errstate(all="ignore"):
        rows[draw.random(rows.shape) < draw.choice([0.01, 0.3, 1.0])] *= scale
    makes: tuple[Callable[[Any], Any], ...] = (
        np.asarray, np.asarray, lambda r: r.astype(np.float32), lambda r: r.astype(np.float16), lambda r: r.astype(str),
        lambda r: r.astype(complex), lambda r: r[0], lambda r: r[:, :, 1:], lambda r: r.tolist(), lambda r: None,
        lambda r: r.astype(object), lambda r: wp.array(r, dtype=wp.float64, device="cpu"),
        lambda r: wp.array(r, dtype=wp.float32, device="cpu"),
    )  # fmt: skip
    with np.errstate(all="ignore"):
        given = makes[draw.integers(len(makes))](rows)
    for _ in range(3):
        try:
            action = policy.act(given)
        except ValueError as error:
            return None if str(error).startswith("observation must ") else f"{name}: {error}"
        action = action if isinstance(action, np.ndarray) else action.numpy()
        if not (np.isfinite(action).all() and np.abs(action).max() <= 1):
            return f"{name} on {scenario}: scale {scale} gives {action.min()} to {action.max()}"
    return None


def hostile_network(draw: np.random.Generator) -> str | None:
    """Networks of any sizes and numbers: refused by name, or played like the formula in float64."""
    base = draw.choice([None, None, "laps", "learned-intruders", ".", "nothing"])
    sizes = [int(size) for size in draw.choice([0, 1, 2, 31, 32, 33, 64, 100], int(draw.integers(0, 4)))]
    if draw.random() < 0.8:
        sizes = [CAR_INPUTS if base is None else CAR_INPUTS + 2, *(max(size, 1) for size in sizes), 2]
    scale = float(draw.choice([0.1, 0.1, 0.1, 1.0, 1e10, 1e38, 1e39, np.nan, np.inf]))
    with np.errstate(all="ignore"):
        weights = tuple(draw.normal(size=(b, a)) * scale for a, b in pairwise(sizes))
    biases = tuple(draw.normal(size=len(weight) + int(draw.random() < 0.03)) for weight in weights)
    activation = str(draw.choice(["relu", "tanh"] * 5 + ["gelu"]))
    residual = draw.choice([1.0, 1.0, np.nan])
    rows = draw.uniform(-1, 1, (3, 5, CAR_INPUTS)).astype(np.float32)
    try:
        network = Network(weights, biases, activation)
        card = Card.of(lissajous_env.scenario("rough"), base=base, residual=float(residual))
        action = Learned(network, card, "rough", 3).act(rows)
    except ValueError as error:
        return None if 0 < len(str(error)) < 500 and "\n" not in str(error) else f"no clear line: {error}"
    if base not in (None, "laps") or not np.isfinite(residual):
        return f"base {base} and residual {residual} were taken"
    if base is not None or scale > 1:
        return None
    x = rows.astype(float)
    for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        x = x @ weight.T.astype(float) + bias
        if k < len(weights) - 1:
            x = np.tanh(x) if activation == "tanh" else np.maximum(x, 0.0)
    off = np.abs(action - np.clip(x, -1, 1)).max()
    return None if off < 1e-3 else f"sizes {sizes}, {activation}: off by {off}"


ATTACKS = [
    Attack(
        "policies in another batch",
        "A row's action is the same, bit for bit, in any batch, at any place, from NumPy and Warp arrays.",
        400,
        in_any_batch,
    ),
    Attack(
        "policies copied in mid-episode",
        "A deep copy, a pickle and a loaded state continue like the original, bit for bit.",
        400,
        copied,
    ),
    Attack(
        "policies that return no numbers",
        "Evaluation, recording and benchmark stop the policy with its name, scenario, world and step.",
        60,
        not_a_number,
    ),
    Attack(
        "hostile observations",
        "Actions are finite and in [-1, 1], or the observation is rejected by name.",
        2000,
        hostile_rows,
    ),
    Attack(
        "hostile networks",
        "A network is rejected in one line, or computes the result of the formula.",
        2000,
        hostile_network,
    ),
]
