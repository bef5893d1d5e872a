"""Attacks on policies: batches, copies, actions and observations that are no numbers, networks of all shapes."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

import baselines
import lissajous_env
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
