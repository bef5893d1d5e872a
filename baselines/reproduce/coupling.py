"""The window of K: the gains of (1) with which five cars preserve the formation and their distances."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from baselines.reproduce.claims import SILENT, Part, at_most, reported
from baselines.reproduce.drawing import BLUE, DARK, GREEN, RED, Picture, Sheet
from baselines.reproduce.episodes import SEEDS, Played, Player, spread_of_cars
from baselines.reproduce.tracking import CLOSEST, ETA, undisturbed
from lissajous_env.world.columns import COLLISIONS, PHASE_ERROR, SEPARATION, SPACING

_GAINS = (0.4, 0.5, 0.62, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.5, 1.75, 2.0, 2.2)
"""K that are tried [1/s]."""
_FEW = 2.0
"""Collisions in an episode, in the mean, up to which a gain counts as good: twice the paper's one."""
_LOST = 1.0
"""Deviation from the equilibrium from which on a formation counts as lost [rad]; it swings by 0.16 rad at K = 1."""


@dataclass(frozen=True)
class _Sweep:
    """Scores of one policy over the gains, (K, W) each."""

    collisions: np.ndarray
    closest: np.ndarray
    """Smallest distance of two robots [m]."""
    spacing: np.ndarray
    """eta_1."""
    deviation: np.ndarray
    """Largest deviation from the equilibrium [rad]."""

    @property
    def good(self) -> list[float]:
        """Gains around K = 1 with few collisions."""
        few = self.collisions.mean(axis=1) <= _FEW
        first = last = _GAINS.index(1.0)
        while first > 0 and few[first - 1]:
            first -= 1
        while last + 1 < len(_GAINS) and few[last + 1]:
            last += 1
        return list(_GAINS[first : last + 1])


def window(player: Player) -> Part:
    """Compute the range of K: collisions and distances of five cars as a function of the gain of (1)."""
    runs = [player.play("kuramoto-mpcc", undisturbed(**{"formation.coupling": K}), worlds=SEEDS) for K in _GAINS]
    columns = (COLLISIONS, SEPARATION, SPACING, PHASE_ERROR)
    sweep = _Sweep(*(np.array([played.score(column) for played in runs]) for column in columns))
    mean = {f"K = {K:g}": float(value) for K, value in zip(_GAINS, sweep.collisions.mean(axis=1), strict=True)}
    lost = (sweep.deviation > _LOST).sum(axis=1)
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
            f"at most {_FEW:g} with K = {sweep.good[0]:g} to {sweep.good[-1]:g}",
            {"low": sweep.good[0], "high": sweep.good[-1], **mean},
        ),
        reported(
            f"seeds that lose the formation: more than {_LOST:g} rad off",
            SILENT,
            ", ".join(f"{count} ({K:g})" for K, count in zip(_GAINS, lost, strict=True) if count) + f" of {SEEDS}",
            "at other K none; with small K the formation is preserved, but robots collide",
        ),
    ]
    return Part(claims, [_picture(sweep, runs[0])])


def _picture(sweep: _Sweep, played: Played) -> Picture:
    """Draw the three scores against K, every seed and the mean."""
    made, body = played.scenario, 2 * played.scenario.robot.radius
    with Sheet("window", "The window of K   Five cars without faults, against the gain of (1)", 7.2, 3.3) as sheet:
        first, second, third = sheet.figure.subplots(1, 3)
        _draw(first, sweep, sweep.collisions, "collisions in 60 s")
        first.set_yscale("symlog", linthresh=1, linscale=0.5)
        first.set_ylim(-0.12, 120)
        first.set_yticks([0, 1, 10, 100], ["0", "1", "10", "100"])
        first.minorticks_off()
        _draw(second, sweep, sweep.closest, "smallest distance [m]")
        second.set_ylim(0, 0.4)
        _line(second, body, f"2 $r_i$: {body:g}", DARK)
        _line(second, CLOSEST, f"paper: {CLOSEST:g}", RED)
        _draw(third, sweep, sweep.spacing, "$\\eta_1$, spacing factor")
        third.set_ylim(0.95, 2.45)
        _line(third, ETA, f"paper: {ETA:g}", RED, at_left=True)
        _line(third, 1, "2 $r_s$ of (8)", DARK)
        return sheet.picture(
            f"`experiment` without faults, {SEEDS} seeds for each K (dots) and their mean (line); green: at most "
            f"{_FEW:g} collisions in the mean; at 2 r_i bodies collide. Cars differ by {spread_of_cars(made)} in "
            "wheelbase and drive. (1) is printed without a gain, so K = 1. With less, robots collide although "
            "the formation is preserved; with more it oscillates, and is lost."
        )


def _draw(axes: Axes, sweep: _Sweep, values: np.ndarray, name: str) -> None:
    """Draw (K, W) values over K, the window behind them."""
    between = [(a + b) / 2 for a, b in pairwise(_GAINS)]
    low, high = _GAINS.index(sweep.good[0]), _GAINS.index(sweep.good[-1])
    axes.axvspan(between[low - 1], between[high], color=GREEN, alpha=0.15, lw=0)
    axes.plot(np.repeat(_GAINS, values.shape[1]), values.ravel(), "o", color=BLUE, ms=2.6, alpha=0.35, mew=0)
    axes.plot(_GAINS, values.mean(axis=1), color=BLUE, lw=1.6)
    axes.set_xlabel("K [1/s]")
    axes.set_ylabel(name)
    axes.set_xlim(0.3, 2.3)
    axes.set_xticks([0.5, 1, 1.5, 2])


def _line(axes: Axes, height: float, word: str, colour: str, at_left: bool = False) -> None:
    """Draw a line across with a word above one of its ends."""
    axes.axhline(height, color=colour, lw=0.9, ls="--", zorder=1)
    x, side = (0.32, "left") if at_left else (2.28, "right")
    axes.annotate(word, (x, height), xytext=(0, 3), textcoords="offset points", ha=side, va="bottom", fontsize=7,
                  color=colour)  # fmt: skip
