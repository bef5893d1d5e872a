"""Fig. 2 and 3: the formation on the curve, and its detection of every moving target."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from baselines.reproduce.claims import SILENT, Part, all_of, at_most, near, reported
from baselines.reproduce.drawing import BLUE, DARK, GREEN, GREY, RED, draw_plane, draw_ring, mark_time, sheet
from baselines.reproduce.episodes import BARE, Player
from lissajous_env import scenario
from lissajous_env.theory import closed_forms
from lissajous_env.world.columns import COLLISIONS, SPACING

_STARTS = 32
"""Starts turned by a random angle, beside that of theta_0 = 0."""
_CHOSEN = "The paper states N = 15 and omega = 0.05 rad/s; A = B = 5 m, a = 7, b = 8, p = 7 are chosen here"


def fig2(player: Player) -> Part:
    """Reproduce Fig. 2: the formation on the curve over time."""
    whole = scenario("ideal").detection_time_bound
    frames = {"formation.start": "equilibrium", "task.step": whole / 64, "task.duration": whole}
    played = player.play("kuramoto", scenario("ideal", **BARE | frames))
    ideal, curve = played.scenario, played.scenario.curve
    gamma = ideal.alpha * played.phase[:, 0, 0]
    residual = closed_forms.ellipse_residual(curve, played.position[:, 0, :, :2], gamma[:, None])

    with sheet("fig2", "Fig. 2   Formation on the Lissajous curve, and ellipse (5)", 7.2, 4.55) as picture:
        across = np.linspace(-1.02, 1.02, 300)
        for k in range(8):
            axes = picture.figure.add_subplot(2, 4, k + 1)
            axes.set_title(f"t = {played.time[8 * k]:.2f} s")
            draw_plane(axes, curve)
            position = played.position[8 * k, 0, :, :2]
            for x, y in position:
                axes.add_patch(Circle((x, y), ideal.detection_radius, color=BLUE, alpha=0.07, lw=0))
            x, y = np.meshgrid(curve.half_width * across, curve.half_height * across)
            off = closed_forms.ellipse_residual(curve, np.stack([x, y], axis=-1), gamma[8 * k])
            axes.contour(x, y, off, [0], colors=GREEN, linewidths=1.1, linestyles="dashed", zorder=3)
            draw_ring(axes, position, ideal.neighbours, lw=1.3)
            axes.plot(*position.T, "o", color=BLUE, ms=3.6, zorder=4)
            axes.set_xlim(-1.3 * curve.half_width, 1.3 * curve.half_width)
            axes.set_ylim(-1.3 * curve.half_height, 1.3 * curve.half_height)
        picture.caption = (
            f"Robots blue, with their sensing discs of {ideal.detection_radius:.2f} m, the smallest by (8); edges of "
            "the ring orange; ellipse (5) green, dashed. The ellipse passes over every point of the rectangle within "
            f"T_max = {whole:.2f} s, of which eight instants are shown. {_CHOSEN}, and alpha = {ideal.alpha} (Lemma "
            "2), which makes ring neighbours neighbours on the ellipse."
        )
    body = f"bodies of {ideal.robot.radius} m, (6) allows {ideal.robot_radius_bound:.4f} m"
    yield at_most("robots stay on ellipse (5): residual", "0", float(np.abs(residual).max()), 1e-4, why=_CHOSEN)
    yield at_most("no collision, r_i < r_max of (6)", "0", played.score(COLLISIONS).max(), 0, why=body)
    yield at_most(
        "sensing discs of ring neighbours overlap, r_s by (8): largest distance / 2 r_s",
        "1",
        played.score(SPACING).max(),
        1 + 1e-6,
        digits=".4f",
    )
    yield picture


def fig3(player: Player) -> Part:
    """Reproduce Fig. 3: new detections over time."""
    step = 0.05
    fine = {"task.step": step, "task.grid": None}
    played = player.play("kuramoto", scenario("ideal", **fine | {"formation.start": "equilibrium"}))
    turned = player.play("kuramoto", scenario("ideal", **fine | {"formation.start": "rotated"}), worlds=_STARTS)
    ideal, waited, detected = played.scenario, played.detection_times[0], played.detected[0]
    last, last_turned = float(waited.max()), np.array([times.max() for times in turned.detection_times])
    bound = ideal.detection_time_bound

    with sheet("fig3", "Fig. 3   Detection of 10,000 moving targets", 7.2, 3.1) as picture:
        left, right = picture.figure.subplots(1, 2, sharex=True)
        counts = np.bincount(np.ceil(waited[detected] / step - 1e-6).astype(int), minlength=round(bound / step) + 1)
        left.stairs(counts, (np.arange(len(counts) + 1) - 0.5) * step, fill=True, color=BLUE, lw=0)
        left.set(yscale="log", ylabel=f"new detections in {step} s")
        words: dict[str, Any] = {"textcoords": "offset points", "va": "top", "fontsize": 8, "color": DARK}
        words |= {"xytext": (16, -3), "arrowprops": {"arrowstyle": "-", "color": GREY, "lw": 0.7}}
        left.annotate(f"{counts[0]:,} in sight\nat the start", (0.03, counts[0]), **words)
        for times, which in zip(turned.detection_times, turned.detected, strict=True):
            _draw_share(right, times, which, color=GREY, lw=0.4, alpha=0.7)
        _draw_share(right, waited, detected, color=BLUE, lw=1.8)
        right.plot([], [], color=BLUE, lw=1.8, label="start at $\\theta_0 = 0$, as on the left")
        right.plot([], [], color=GREY, lw=0.8, label=f"{_STARTS} starts at a random $\\theta_0$")
        shown = right.legend(loc="center right", bbox_to_anchor=(0.93, 0.5), frameon=True, edgecolor="none")
        shown.set_zorder(5)
        right.set_ylabel("share of the targets detected")
        for axes in (left, right):
            axes.set(xlabel="time t [s]", xlim=(-0.15, 8.95))
            mark_time(axes, 4.5, "4.5 s\n(paper)", 0.97 if axes is left else 0.22, RED)
            mark_time(axes, bound, "$T_{max}$", 0.97 if axes is left else 0.22, side="right")
        picture.caption = (
            f"{_CHOSEN}; the paper does not state the targets' motion either: here they wander at "
            f"{ideal.targets.speed} m/s, their heading changing by {ideal.targets.turn_rate:g} rad in one second. "
            "theta_0 = 0 is a slow start: two corners are covered only after T_max / 2, when the ellipse is a circle "
            "again and stretches towards them."
        )
    runs = zip([waited, *turned.detection_times], [detected, *turned.detected], strict=True)
    in_time = np.array([which.all() and times.max() <= bound for times, which in runs])
    in_sight = 100 * float(np.mean(waited == 0))
    by = " and ".join(f"{x:.2f} s" for x in (last_turned.min(), last_turned.max()))
    yield near("T_max for N = 15, omega = 0.05 rad/s", 8.38, bound, 0.005, "s")
    yield all_of("every target is detected by T_max", "all", in_time, "starts", _CHOSEN)
    yield near(
        "the last of 10,000 targets is detected at",
        4.5,
        last,
        0.3,
        "s",
        f"theta_0 = 0; between {by} for {_STARTS} random theta_0. Motion of the targets chosen: "
        f"{ideal.targets.speed} m/s, wandering",
    )
    yield reported("share in sight at the start", SILENT, f"{in_sight:.1f} %", "56 % in an independent simulation")
    yield picture


def _draw_share(axes: Axes, times: np.ndarray, detected: np.ndarray, **line: Any) -> None:
    """Draw the share of the targets (K,) detected over time [s], the Kaplan-Meier estimate."""
    from scipy import stats  # its import takes longer than that of this project

    curve = stats.ecdf(stats.CensoredData.right_censored(times, ~detected)).cdf
    at, share = curve.quantiles, curve.probabilities
    axes.step([0, *at[::20], at[-1], 9], [0, *share[::20], share[-1], share[-1]], where="post", **line)
