"""Section VII as printed, and with what it does not print: the effect of the constants of car, controller and gain."""

import numpy as np

from baselines.mpcc.parameters import MpccParameters
from baselines.reproduce.claims import SILENT, Claim, Part, at_most, reported
from baselines.reproduce.episodes import SEEDS, Played, Player
from baselines.reproduce.tracking import CLOSEST, undisturbed
from lissajous_env import scenario
from lissajous_env.theory import geometry
from lissajous_env.world.columns import COLLISIONS, PHASE_ERROR, SEPARATION

_GAINS = (0.4, 0.5, 0.62, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.5, 1.75, 2.0, 2.2)
"""K that are tried [1/s]."""
_FEW = 2.0
"""Collisions in an episode, in the mean, up to which a gain counts as good: twice the paper's one."""
_LOST = 1.0
"""Deviation from the equilibrium from which on a formation counts as lost [rad]; it swings by 0.16 rad at K = 1."""


def printed(player: Player) -> Part:
    """Simulate Section VII as printed: beta = 0.94, and the order of q1 and q2."""
    ours = player.play("kuramoto-mpcc", undisturbed(), worlds=SEEDS)
    beta = player.play("kuramoto-mpcc", scenario("experiment-printed", **{"faults.schedule": ()}), worlds=4)
    weights = MpccParameters()
    order = player.play(
        "kuramoto-mpcc",
        undisturbed(),
        worlds=SEEDS,
        weight_lateral=weights.weight_lag,
        weight_lag=weights.weight_lateral,
    )
    outside, allowed = _outside(beta), 0.2
    made, model = beta.scenario, beta.scenario.robot
    slowest = (model.drive * model.throttle_min - model.offset) / model.drag
    fastest = geometry.top_speed(made.curve, made.formation.phase_rate)
    closest = order.score(SEPARATION)
    claims = [
        Claim(
            f"beta = {model.offset:g} in (12): the formation is preserved",
            "preserved",
            f"cars leave the rectangle by {outside:.1f} m, {beta.deviation.max():.2f} rad off",
            f"at most {allowed:g} rad",
            bool(beta.deviation.max() < allowed),
            f"the slowest car drives {slowest:.1f} m/s at tau = {model.throttle_min:g}, the curve requires "
            f"{fastest:.2f} m/s at most: beta is misprinted",
            {"outside": outside, "ours": float(beta.deviation.max()), "slowest": slowest, "fastest": fastest},
        ),
        Claim(
            f"q1 = {weights.weight_lateral:g} on the lag, q2 = {weights.weight_lag:g} on the lateral error: smallest "
            "distance",
            f"{CLOSEST:g} m",
            _range(closest) + " m",
            f"the range with q1, q2 exchanged: {_range(ours.score(SEPARATION))} m",
            bool(closest.min() <= CLOSEST <= closest.max()),
            f"{order.score(COLLISIONS).mean():.0f} collisions in {order.scenario.task.duration:g} s instead of "
            f"{ours.score(COLLISIONS).mean():.1f}: we take q1 as the weight of the lateral error",
            {"paper": CLOSEST, "low": closest.min(), "high": closest.max()},
        ),
        _step(player, ours),
    ]
    return Part(claims)


def _step(player: Player, ours: Played) -> Claim:
    """Report the effect of the one constant of the controller that the paper does not print."""
    touches = []
    for step in (0.05, 0.15):
        played = player.play("kuramoto-mpcc", undisturbed(), worlds=SEEDS, step=step)
        touches.append(f"{played.score(COLLISIONS).mean():.1f} with {step:g} s")
    return reported(
        "step of the controller's M = 15 stages: collisions in 60 s",
        SILENT,
        f"{ours.score(COLLISIONS).mean():.1f} with {MpccParameters().step:g} s; {'; '.join(touches)}",
        "the paper prints M alone; 0.1 s is the rate of the control, and the one of these that works",
    )


def window(player: Player) -> Part:
    """Compute the range of K: collisions and distances of five cars as a function of the gain of (1)."""
    runs = [player.play("kuramoto-mpcc", undisturbed(**{"formation.coupling": K}), worlds=SEEDS) for K in _GAINS]
    mean = {f"K = {K:g}": float(played.score(COLLISIONS).mean()) for K, played in zip(_GAINS, runs, strict=True)}
    low, high = _around_one([value <= _FEW for value in mean.values()])
    lost = [int((played.score(PHASE_ERROR) > _LOST).sum()) for played in runs]
    claims = [
        at_most(
            f"K = 1, as (1) is printed: collisions in 60 s, the mean of {SEEDS} seeds",
            "1",
            mean["K = 1"],
            _FEW,
            why="for cars the choice K = 1 matters: see the next rows",
        ),
        reported(
            "the same for other K",
            SILENT,
            ", ".join(f"{value:.1f} ({name[4:]})" for name, value in mean.items()),
            f"at most {_FEW:g} with K = {low:g} to {high:g}",
            {"low": low, "high": high, **mean},
        ),
        reported(
            f"seeds that lose the formation: more than {_LOST:g} rad off",
            SILENT,
            ", ".join(f"{count} ({K:g})" for K, count in zip(_GAINS, lost, strict=True) if count) + f" of {SEEDS}",
            "at other K none; with small K the formation is preserved, but robots collide",
        ),
    ]
    return Part(claims)


def _around_one(good: list[bool]) -> tuple[float, float]:
    """Return the smallest and the largest of the good gains around K = 1."""
    first = last = _GAINS.index(1.0)
    while first > 0 and good[first - 1]:
        first -= 1
    while last + 1 < len(_GAINS) and good[last + 1]:
        last += 1
    return _GAINS[first], _GAINS[last]


def _outside(played: Played) -> float:
    """Return how far a robot gets out of the rectangle [m]."""
    curve = played.scenario.curve
    beyond = np.abs(played.position[..., :2]) - np.array([curve.half_width, curve.half_height])
    return float(beyond.max())


def _range(values: np.ndarray) -> str:
    return f"{values.min():.3f} to {values.max():.3f}"
