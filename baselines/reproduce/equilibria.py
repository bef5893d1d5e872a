"""Theorem 1 and 2, Lemma 1 and 2: which equilibria there are, which are stable, how robots share their places."""

import math

import numpy as np

from baselines.reproduce.claims import Claim, Part, all_of
from baselines.reproduce.episodes import BARE, PlayedEpisodes, Player
from lissajous_env import scenario
from lissajous_env.theory import closed_forms
from lissajous_env.world.tally import RECOVERED

_NUMBERS = (5, 6, 7, 8, 10, 15)
_STARTS = 300


def theorem1(player: Player) -> Part:
    """Test Theorem 1: equilibria reached from random starts."""
    claims = []
    for n in _NUMBERS:
        played = _random_starts(player, n)
        reached = played.winding[-1]
        share = np.bincount(reached, minlength=n)[:n] / _STARTS
        inside = np.isin(reached, closed_forms.stable_equilibria(n)) & _settled(played)
        reached_p = [p for p in np.argsort(-share) if share[p] > 0]
        claims.append(
            all_of(
                f"N = {n}: random starts converge to p in (N/4, 3N/4) = ({n / 4:g}, {3 * n / 4:g})",
                "all",
                inside,
                "starts",
                ", ".join(f"p = {p} {100 * share[p]:.2g} %" for p in reached_p),
            )
        )
    return Part(claims)


def theorem2(player: Player) -> Part:
    """Test Theorem 2: stable equilibria with one robot at each place."""
    # Not by the rule of Theorem 1 but by the eigenvalues of the Jacobian, as numbers.
    numbers = [n for n in range(3, 41) if n not in (4, 6)]
    exists = [any(_is_stable(n, p) and math.gcd(n, p) == 1 for p in range(n)) for n in numbers]
    exceptions = [any(_is_stable(n, p) and math.gcd(n, p) == 1 for p in range(n)) for n in (4, 6)]
    claims = [
        all_of(
            "a stable 1-clustered equilibrium exists, by the eigenvalues of the Jacobian, N = 3 ... 40 without 4 and 6",
            "always",
            exists,
            "numbers of robots",
        ),
        Claim(
            "none for N = 4 and 6",
            "excluded",
            f"{sum(exceptions)} of 2",
            "0",
            not any(exceptions),
            "robots always share places: p = 2 is the only one of 4, p = 2, 3, 4 none co-prime to 6",
        ),
    ]
    return Part(claims)


def lemmas(player: Player) -> Part:
    """Test Lemma 1 and 2: clusters, and equilibria made of others."""
    shared = []
    for n in _NUMBERS:
        played = _random_starts(player, n)
        for reached, phases in zip(played.winding[-1], played.phase[-1], strict=True):
            apart = np.abs(np.angle(np.exp(1j * (phases[:, None] - phases))))
            # Of kappa robots in one place every one has kappa robots, itself included, within a hair.
            shared.append(bool(np.all((apart < 0.02).sum(axis=1) == math.gcd(n, reached))))
    odd = range(3, 102, 2)
    manipulated = []
    for n in odd:
        base = closed_forms.equilibrium_phases(n, (n - 1) // 2, range(n))
        for wanted in range(n):
            alpha = closed_forms.alpha_for(n, (n - 1) // 2, wanted)
            if alpha is None:
                manipulated.append(False)
                continue
            off = alpha * base - closed_forms.equilibrium_phases(n, wanted, range(n))
            manipulated.append(bool(np.abs(np.angle(np.exp(1j * off))).max() < 1e-6))
    claims = [
        all_of(
            "Lemma 1: gcd(N, p) robots share a place in the equilibrium reached",
            "always",
            shared,
            "starts",
            "the end states of theorem1",
        ),
        all_of(
            "Lemma 2: alpha times equilibrium (N - 1) / 2 is any equilibrium, N odd up to 101",
            "always",
            manipulated,
            "equilibria",
            "alpha = p / ((N - 1) / 2) modulo N; the paper does not state which",
        ),
    ]
    return Part(claims)


def _random_starts(player: Player, n: int) -> PlayedEpisodes:
    """Return the phases of N points, simulated from uniform random ones until they rest."""
    bare = BARE | {"formation.start": "random", "formation.alpha": 1, "formation.p": None, "robot.count": n}
    bare |= {"task.step": 0.25, "task.duration": 150.0}
    # Theorem 1 is of (1) as it is, without a bound on the speed: omega + 2 K is the highest rate that (1) requires.
    bare |= {"robot.phase_rate_max": 0.3 + 2 * 1.0}
    bare |= {"sensing.radius": 1.0, "sensing.robots_seen": 0, "sensing.targets_seen": 0}
    return player.play("kuramoto", scenario("failure", **bare), worlds=_STARTS, only_ends=True)


def _settled(played: PlayedEpisodes) -> np.ndarray:
    """Return whether all steps along the ring are equal (W,), so that the state is some equilibrium (2)."""
    ahead = played.steps_ahead[-1]
    target = 2 * np.pi * played.winding[-1][:, None] / ahead.shape[-1]
    return np.abs(np.angle(np.exp(1j * (ahead - target)))).max(axis=-1) < RECOVERED


def _is_stable(n: int, p: int) -> bool:
    """Return whether all eigenvalues of the Jacobian, except that of the common rotation, are negative."""
    ring = np.eye(n)
    slope = math.cos(2 * math.pi * p / n)  # d theta_i' / d theta_j = -slope for the neighbours, proof of Theorem 3
    jacobian = slope * (2 * ring - np.roll(ring, 1, axis=0) - np.roll(ring, -1, axis=0))
    return bool(np.sort(np.linalg.eigvalsh(jacobian))[-2] < -1e-9)
