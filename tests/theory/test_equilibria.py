"""Equilibria of the formation: stability, shape and tolerance of faults, compared with the dynamics (1)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lissajous_env.parameters.scenario import Curve
from lissajous_env.theory import closed_forms

# Theorems 1 and 2, Lemmas 1 and 2.


def ring_neighbours(num_robots):
    """(N, 2) neighbours on the ring 0, 1 ... N - 1."""
    robots = np.arange(num_robots)
    return np.stack([(robots - 1) % num_robots, (robots + 1) % num_robots], axis=1)


@pytest.mark.parametrize("n", [3, 4, 6, 10, 15])
def test_stable_equilibria_are_those_of_the_dynamics(n):
    # Oracle: eigenvalues of a Jacobian by finite differences of (1).
    neighbours = ring_neighbours(n)
    for p in range(n):
        phases = closed_forms.equilibrium_phases(n, p, range(n))
        assert closed_forms.kuramoto_rates(phases, neighbours, 0.3, 1.0) == pytest.approx(0.3)
        steps = 1e-6 * np.eye(n)
        above, below = (closed_forms.kuramoto_rates(phases + sign * steps, neighbours, 0.3, 1.0) for sign in (1, -1))
        jacobian = ((above - below) / 2e-6).T
        eigenvalues = np.sort(np.linalg.eigvals(jacobian).real)
        assert np.sort(closed_forms.equilibrium_eigenvalues(n, p)) == pytest.approx(eigenvalues, abs=1e-6)
        stable = eigenvalues[-1] < 1e-6 and eigenvalues[-2] < -1e-4
        assert stable == (p in closed_forms.stable_equilibria(n)) == (n / 4 < p < 3 * n / 4)


@given(st.integers(2, 200))
def test_theorem_2(n):
    assert closed_forms.has_unclustered_equilibrium(n) == (n not in {4, 6})
    assert (closed_forms.cluster_size(n, closed_forms.default_p(n)) == 1) == (n not in {4, 6})
    assert closed_forms.default_p(n) in closed_forms.stable_equilibria(n)


@given(st.integers(3, 60), st.integers(0, 60), st.integers(1, 9))
def test_lemma_1_counts_robots_on_a_place(n, p, alpha):
    turns = alpha * p * np.arange(n) % n
    assert np.all(np.unique(turns, return_counts=True)[1] == closed_forms.cluster_size(n, p, alpha))


@given(st.integers(1, 30).map(lambda k: 2 * k + 1))
def test_lemma_2_reaches_every_equilibrium(n):
    p = (n - 1) // 2
    for wanted in range(n):
        alpha = closed_forms.alpha_for(n, p, wanted)
        assert alpha is not None
        assert alpha * p % n == wanted
        assert 1 <= alpha <= n


@pytest.mark.parametrize(
    ("a", "n", "p", "alpha"), [(3, 5, 2, 1), (7, 10, 3, 1), (7, 15, 7, 4), (11, 15, 7, 8), (1, 5, 2, 3)]
)
def test_alpha_rule(a, n, p, alpha):
    # Oracle: the paper's experiment (5) and Fig. 4 (10) need none; alpha a p = 1 (mod N) by hand.
    assert closed_forms.default_alpha(Curve(5, 5, a, n - a), n, p) == alpha
    assert alpha * a * p % n == 1


@pytest.mark.parametrize("n", [5, 10, 15])
def test_ring_lies_on_ellipse_exactly_by_the_rule(n):
    # Oracle: the order of the robots around the centre of the ellipse, seen in a frame where it is a circle.
    for a in [a for a in range(1, n, 2) if math.gcd(a, n) == 1]:
        curve = Curve(5, 3, a, n - a)
        for p in [p for p in closed_forms.stable_equilibria(n) if math.gcd(p, n) == 1]:
            for alpha in [alpha for alpha in range(1, n) if math.gcd(alpha, n) == 1]:
                phases = alpha * closed_forms.equilibrium_phases(n, p, range(n))
                positions = closed_forms.curve_point(curve, phases + 0.1) / [5, 3]
                values, axes = np.linalg.eigh(positions.T @ positions)
                angles = np.arctan2(*(positions @ axes / np.sqrt(values)).T)
                place = np.argsort(np.argsort(angles))
                apart = (place - np.roll(place, 1)) % n
                beside = bool(np.all((apart == 1) | (apart == n - 1)))
                assert beside == closed_forms.ring_lies_on_ellipse(curve, n, p, alpha)


# (9) and Theorem 4: resilience. Oracle: (1) integrated.


def integrate(phases, duration, step=0.02, phase_rate=0.3, coupling=1.0, stuck=()):
    """RK4 on (1); robots in `stuck` do not move."""
    neighbours = ring_neighbours(phases.shape[-1])
    free = np.ones(phases.shape[-1])
    free[list(stuck)] = 0

    def rates(x):
        return free * closed_forms.kuramoto_rates(x, neighbours, phase_rate, coupling)

    for _ in range(round(duration / step)):
        k1 = rates(phases)
        k2 = rates(phases + step / 2 * k1)
        k3 = rates(phases + step / 2 * k2)
        k4 = rates(phases + step * k3)
        phases = phases + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return phases


def deviation(phases, p):
    """Largest deviation from equilibrium p with theta_0 taken from robot 0 [rad]."""
    offsets = phases - closed_forms.equilibrium_phases(phases.shape[-1], p, range(phases.shape[-1]))
    return np.abs(np.angle(np.exp(1j * (offsets - offsets[..., :1])))).max(axis=-1)


@pytest.mark.parametrize(("n", "p"), [(5, 2), (7, 3), (10, 3), (15, 7)])
def test_admissible_displacement(n, p):
    high = closed_forms.admissible_displacement(n, p)
    phase = 2 * np.pi * p / n
    for displacement, inside in [(high - 1e-6, True), (high + 1e-6, False), (1e-6 - high, True), (-high - 1e-6, False)]:
        holds = max(math.cos(-phase + displacement), math.cos(phase + displacement)) < 0
        assert holds == inside
    starts = np.tile(closed_forms.equilibrium_phases(n, p, range(n)), (9, 1))
    starts[:, 0] += np.linspace(-high, high, 11)[1:-1]
    assert np.all(deviation(integrate(starts, 100, step=0.1), p) < 0.05)
