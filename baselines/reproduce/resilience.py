"""Fig. 4 and 6, Theorems 3 and 4: a robot that is displaced, and two robots that fail and resume."""

from itertools import product
from typing import Any

import numpy as np

from baselines.reproduce.claims import SILENT, Claim, Part, all_of, at_most, reported
from baselines.reproduce.drawing import (
    BLUE,
    DARK,
    GREEN,
    ORANGE,
    RED,
    SERIES,
    draw_plane,
    draw_ring,
    mark_time,
    name_line,
    sheet,
)
from baselines.reproduce.episodes import BARE, SEEDS, EpisodeArrays, Player
from lissajous_env import scenario
from lissajous_env.theory import closed_forms
from lissajous_env.world.columns import COLLISIONS, RECOVERY
from lissajous_env.world.tally import RECOVERED

_FORMATIONS = ((5, 2), (7, 2), (7, 3), (8, 3), (10, 3), (10, 4), (15, 7))
"""N and p, with the narrowest and the widest intervals of (9)."""
_INSIDE = 9
"""Random displacements inside the interval, for each formation."""
_FAILING = ((5, 2), (7, 3), (10, 3), (15, 7))
"""N and p of Theorem 4; N = 10, p = 3 is that of Fig. 4."""
_PAIRS = ((0, 1), (0, 2), (0, 3))
_LASTING = (1.0, 2.0, 5.0, 9.9, 20.0)
"""Time for which two robots have failed [s]; 9.9 s as in Fig. 6."""
_FINE = 0.01
"""Control step of the episode that shows the effect of the control step [s]."""


def _displaced(player: Player, name: str, angle: float, duration: float, **overrides: object) -> EpisodeArrays:
    """Play an episode of points, of a duration [s], in which robot 0 starts displaced by an angle [rad]."""
    bare = {**BARE, "task.duration": duration, "task.step": 0.25, "formation.displaced": ((0, float(angle)),)}
    return player.play("kuramoto", scenario(name, **bare | overrides))


def fig4(player: Player) -> Part:
    """Reproduce Fig. 4: the admissible displacement of one robot of ten."""
    perturbation = scenario("perturbation").resolve()
    curve, n = perturbation.curve, perturbation.num_robots
    half = closed_forms.admissible_displacement(n, perturbation.p)
    inside = np.random.default_rng(player.seed).uniform(-half, half, 20)
    back = [_displaced(player, "perturbation", angle, 60).returned[0] for angle in inside]
    outside = np.arange(1.02 * half, np.pi, 0.04)
    returned = np.array([_displaced(player, "perturbation", angle, 60).returned[0] for angle in outside])
    leaves = float(outside[~returned].min(initial=np.pi))

    with sheet("fig4", "Fig. 4   Ten robots, and how far one of them may be displaced", 7.2, 4.0) as picture:
        left, right = picture.figure.subplots(1, 2, width_ratios=(1.25, 1))
        draw_plane(left, curve, color=RED, ls=":", lw=0.9, label="curve")
        gamma = perturbation.alpha * perturbation.equilibrium
        position = closed_forms.curve_point(curve, gamma)
        draw_ring(left, position, perturbation.neighbours, label="ring")
        around = closed_forms.curve_point(curve, perturbation.alpha * np.linspace(-half, half, 200) + gamma[0])
        left.plot(*around.T, color=GREEN, lw=2.6, ls=(0, (2.2, 1)), zorder=3, label="(9) for robot 1")
        left.plot(*position.T, "o", color=BLUE, ms=9, zorder=4, label="robots")
        for robot, place in enumerate(position):
            left.annotate(f"{robot + 1}", place, ha="center", va="center", fontsize=6.5, color="white", zorder=5)
        below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.02), "ncols": 4}
        left.legend(**below, handlelength=1.6, columnspacing=1.2, markerscale=0.6)

        cases = ((0.95 * half, GREEN, "inside"), (1.6 * half, BLUE, "outside"), (leaves, RED, "outside"))
        for angle, colour, word in cases:
            played = _displaced(player, "perturbation", angle, 60)
            right.plot(played.time, played.deviation[:, 0], color=colour, label=f"{angle:.2f} rad, {word} (9)")
        right.axhline(RECOVERED, color=DARK, lw=0.8, ls="--")
        right.annotate(f"{RECOVERED} rad: recovered", (60, 1.12 * RECOVERED), ha="right", fontsize=8, color=DARK)
        right.set(yscale="log", ylim=(1e-3, 6))
        right.set(xlabel="time since the displacement [s]", ylabel="largest deviation from the equilibrium [rad]")
        right.legend(loc="center right", bbox_to_anchor=(1, 0.68), title="robot 1 displaced by", title_fontsize=8)
        picture.caption = (
            f"N = 10, a = 7, b = 3, A = B = 5 m as in the paper; p = {perturbation.p} and the ring 1, 2 ... 10 are "
            f"chosen, with which (9) is |displacement| < {half:.3f} rad. The condition is sufficient: simulated, the "
            f"formation comes back from up to {leaves - 0.04:.2f} rad and leaves for another equilibrium from "
            f"{leaves:.2f} rad on."
        )
    yield all_of(
        f"displaced inside (9), |d| < {half:.3f} rad, the same equilibrium returns",
        "always",
        back,
        "random displacements",
        "p = 3 and K = 1 chosen; robots as points",
    )
    yield Claim(
        "displaced outside (9) it need not return",
        "no guarantee",
        f"it leaves from {leaves:.2f} rad on",
        f"some |d| > {half:.3f} rad leaves",
        not returned.all(),
        f"(9) is sufficient only: it still returns up to {leaves - 0.04:.2f} rad, {leaves / half:.1f} times (9)",
    )
    yield picture


def theorem3(player: Player) -> Part:
    """Test Theorem 3: a robot that is displaced within (9) returns."""
    random = np.random.default_rng(player.seed)
    returned: list[bool] = []
    unmet, tried = 0, 0
    for n, p in _FORMATIONS:
        half = closed_forms.admissible_displacement(n, p)
        # A formation takes longest where an eigenvalue of its linearisation is nearest to 0.
        slowest = -closed_forms.equilibrium_eigenvalues(n, p)[1]
        at_rest = {"robot.count": n, "formation.p": p, "formation.alpha": 1, "formation.start": "equilibrium",
                   "sensing.radius": 1.0}  # fmt: skip
        angles = [*random.uniform(-half, half, _INSIDE), *np.linspace(-3.1, 3.1, 21)]
        plays = [_displaced(player, "failure", d, 20 + 5 / slowest, **at_rest) for d in angles]
        back = np.array([played.returned[0] for played in plays])
        admissible = np.abs(angles) < half
        returned += list(back[admissible])
        unmet, tried = unmet + int(np.sum(back & ~admissible)), tried + int(np.sum(~admissible))
    why = f"{len(_FORMATIONS)} formations; {unmet} of {tried} displacements outside (9) return too: not necessary"
    yield all_of("condition (9) suffices", "always returns", returned, "return", why)


def fig6(player: Player) -> Part:
    """Reproduce Fig. 6: two robots fail and resume, with feedback and without."""
    failure = scenario("failure", **{"formation.start": "rotated"})
    runs = {
        "(a) time-inverted Kuramoto": player.play("kuramoto", failure, worlds=SEEDS),
        "(b) reference points in open loop [15]": player.play("tracked-reference", failure, worlds=SEEDS),
    }
    first, second = failure.faults.schedule[0][1:]
    with sheet("fig6", "Fig. 6   Two of five robots fail and resume", 7.2, 4.5) as picture:
        grid = picture.figure.subplots(2, 2, sharex=True, sharey="row", height_ratios=(1.5, 1))
        for column, (name, played) in zip(grid.T, runs.items(), strict=True):
            column[0].set_title(name)
            # The phases of world 0 are shown as if robot 0 had started at phase 0.
            phase: np.ndarray = np.unwrap(played.phase[:, 0], axis=0)
            phase -= phase[0, 0]
            phase -= 2 * np.pi * np.floor(phase[0] / (2 * np.pi) + 1e-9)
            failed = played.failed[:, 0].max(axis=0)
            for robot in range(played.scenario.num_robots):
                line = {"ls": (0, (4, 1.2)), "lw": 1.9} if failed[robot] else {"lw": 1.2}
                column[0].plot(played.time, phase[:, robot], color=SERIES[robot], **line)
                name_line(column[0], played.time[-1], phase[-1, robot], f"{robot + 1}", SERIES[robot])
            column[1].plot(played.time, played.deviation[:, 0], color=BLUE, lw=1.5)
            column[1].axhline(RECOVERED, color=DARK, lw=0.8, ls=":")
            for axes in column:
                axes.axvspan(first, second, color=ORANGE, alpha=0.13, lw=0)
            mark_time(column[0], first, f"$t_1$ = {first} s", 0.98)
            mark_time(column[0], second, f"$t_2$ = {second} s", 0.98)
            column[1].set(xlabel="time t [s]", xlim=(0, failure.task.duration))
        grid[0, 0].set_ylabel("states $\\theta$ [rad]")
        grid[1, 0].set(yscale="log", ylim=(1e-4, 8), ylabel="largest deviation\nfrom (2) [rad]")
        grid[1, 0].annotate(f"{RECOVERED} rad", (0.3, RECOVERED), va="bottom", fontsize=7.5)
        picture.caption = (
            "Five robots as points on curve (16), omega = 0.3 rad/s, K = 1, p = 2; robots 1 and 2 (dashed) are stopped "
            "in the shaded time. The paper does not state which formation it simulated, nor which two robots fail: "
            "those of Section VII and two ring neighbours, the harder case, are chosen. In (b) the generator of a "
            "stopped robot's reference stops with it."
        )
    kuramoto, rival = runs.values()
    recovery = kuramoto.score(RECOVERY)
    finer = scenario(failure, **{"task.step": _FINE, "task.grid": None})
    fine = player.play("kuramoto", finer, worlds=SEEDS).score(RECOVERY)
    cosine, offset = kuramoto.largest_cosine.max(), rival.deviation[-1]
    rule = f"deviation below {RECOVERED} rad and stays, by 30 s"
    yield Claim(
        "(a) Kuramoto returns to the initial equilibrium",
        "quickly after t2",
        f"{recovery.max():.1f} s after t2",
        rule,
        bool(np.isfinite(recovery).all()),
        "the paper states no time; five robots of curve (16), K = 1 chosen",
    )
    yield reported(
        f"(a) with Euler steps of {_FINE:g} s",
        SILENT,
        f"{fine.max():.2f} s after t2",
        f"the phase rate of points is constant in a control step, {failure.task.step:g} s here: Euler's method on (1)",
    )
    yield at_most("(a) the condition of Theorem 4 is met: largest cos(theta_j - theta_i)", "below 0", cosine, 0)
    yield Claim(
        "(b) tracked references [15] never recover",
        "does not recover",
        f"{offset.min():.2f} rad off at 30 s",
        "no recovery time",
        bool(np.isnan(rival.score(RECOVERY)).all()),
        f"the offset stays as it was at t2; {rival.score(COLLISIONS).mean():.0f} collisions in 30 s, with (1) "
        f"{kuramoto.score(COLLISIONS).mean():.1f}",
    )
    yield picture


def theorem4(player: Player) -> Part:
    """Test Theorem 4: two robots fail, and its condition is met during the failure or not."""
    met, broken = [], []
    for (n, p), pair, lasts in product(_FAILING, _PAIRS, _LASTING):
        played = player.play("kuramoto", _two_failures(n, p, pair, lasts))
        (met if played.largest_cosine[0] < 0 else broken).append(bool(played.returned[0]))
    leaving = player.play("kuramoto", _two_failures(10, 3, (0, 1), 9.9))
    why = f"of {len(broken)} failures that violated the condition {sum(broken)} returned nevertheless"
    yield all_of(
        "failures during which the condition was met: the same equilibrium returns", "always", met, "failures", why
    )
    yield Claim(
        "N = 10, p = 3 (Fig. 4), neighbours fail for 9.9 s: condition broken",
        "no guarantee",
        f"p = 3 to p = {leaving.winding[-1, 0]}, cos reaches {leaving.largest_cosine[0]:.2f}",
        "it leaves",
        not leaving.returned[0],
        "the paper fails two robots of another formation only (Fig. 6)",
    )


def _two_failures(n: int, p: int, pair: tuple[int, int], lasts: float) -> Any:
    """Make a scenario of N points in equilibrium p, of which a pair fails for a time [s]."""
    begin = 0.5
    faults = tuple((robot, begin, begin + lasts) for robot in pair)
    bare = BARE | {"robot.count": n, "formation.p": p, "formation.alpha": 1, "formation.start": "equilibrium"}
    bare |= {"sensing.radius": 1.0, "faults.schedule": faults, "task.duration": begin + lasts + 30}
    return scenario("failure", **bare)
