"""Conditions (6), (7) and (8), and T_max: closed forms beside what is measured and simulated."""

import math

import numpy as np

from baselines.reproduce.claims import Claim, all_of, at_most, near
from baselines.reproduce.drawing import BLUE, DARK, GREEN, RED, Sheet, panel_name
from baselines.reproduce.episodes import BARE, Part, Player
from lissajous_env import scenario
from lissajous_env.parameters.scenario import Curve
from lissajous_env.theory import closed_forms, geometry

_SHAPES = ((1.8, 0.8), (5.0, 5.0), (5.0, 3.0))
"""Half width and half height [m] of the rectangles."""
_MOST = 21


def bounds(player: Player) -> Part:
    """Conditions (6), (7), (8) and T_max against what is measured."""
    curves = [
        Curve(A, B, a, n - a)
        for A, B in _SHAPES
        for n in range(3, _MOST + 1)
        for a in range(1, n, 2)
        if n not in (4, 6) and math.gcd(a, n) == 1
    ]
    bodies, sensors, links = [], [], []
    for curve in curves:
        n = curve.a + curve.b
        p = closed_forms.default_p(n)
        alpha = closed_forms.default_alpha(curve, n, p)
        bodies.append(geometry.measured_robot_radius(curve, n) / closed_forms.robot_radius_bound(curve, n))
        sensors.append(geometry.measured_coverage_radius(curve, precision=2e-3) / closed_forms.coverage_radius(curve))
        reach = geometry.largest_neighbour_distance(curve, n, p, alpha)
        links.append(reach / 2 / closed_forms.detection_radius(curve, n))
    odd = np.array([(curve.a + curve.b) % 2 == 1 for curve in curves])

    with Sheet("bounds", "Conditions (6), (7) and (8)   What is measured over what they ask for", 7.2, 2.9) as sheet:
        panels = sheet.figure.subplots(1, 3)
        rows = (
            (bodies, "(6): largest body", GREEN),
            (sensors, "(7): sensor that covers", RED),
            (links, "(8): sensor that detects", RED),
        )
        for axes, (ratios, name, colour) in zip(panels, rows, strict=True):
            count = np.array([curve.a + curve.b for curve in curves])
            axes.plot(count, ratios, "o", color=BLUE, ms=2.6, alpha=0.6, mew=0)
            axes.axhline(1, color=DARK, lw=1, ls="--")
            axes.set_xlabel("N")
            axes.set_ylim(0, 1.7)
            panel_name(axes, name)
            axes.annotate("safe" if colour == GREEN else "more than is needed", (21, 1.0 if colour == GREEN else 0.98),
                          ha="right", va="bottom" if colour == GREEN else "top", fontsize=7.5, color=DARK,
                          xytext=(0, 2 if colour == GREEN else -2), textcoords="offset points")  # fmt: skip
        panels[0].set_ylabel("measured / closed form")
        picture = sheet.picture(
            f"Every curve with a odd, a + b = N, gcd(a, b) = 1, N = 3 ... {_MOST} without 4 and 6, in rectangles of "
            "3.6 m x 1.6 m, 10 m x 10 m and 10 m x 6 m. (6): half of the smallest distance ever seen in "
            "formation; (7): "
            "the radius with which one lap covers the rectangle; (8): half of the largest distance of ring neighbours."
        )

    larger = [ratio for ratio, curve in zip(bodies, curves, strict=True) if curve.a + curve.b > 3]
    flat = scenario("failure").curve
    lap = 2 * math.pi / 0.3
    covering = {"sensing.radius": closed_forms.coverage_radius(flat), "task.grid": (36, 16), "task.duration": lap}
    swept = player.play("kuramoto", scenario("failure", **BARE | covering), worlds=16, only_ends=True)
    undisturbed = player.play(
        "kuramoto", scenario("failure", **BARE | {"task.duration": lap}), worlds=16, only_ends=True
    )
    simulated = float(undisturbed.score("min_separation").min()) / 2
    links_odd = np.array(links)[odd]
    needed = geometry.measured_coverage_radius(flat)
    count = f"{len(curves)} curves, N = 3 ... {_MOST}"
    claims = [
        near(
            "T_max of the experiment, N = 5, omega = 0.3 rad/s",
            4.189,
            closed_forms.detection_time_bound(0.3, 5),
            5e-4,
            "s",
            "by the formula",
        ),
        all_of(
            "(6): bodies below r_max never touch in formation",
            "always",
            np.array(bodies) >= 1,
            "curves",
            f"conservative: the measured radius is {min(larger):.2f} to {max(bodies):.2f} times r_max for N >= 5, "
            f"from {min(bodies):.2f} times on for N = 3",
        ),
        Claim(
            "(6): r_max of curve (16)",
            f"{closed_forms.robot_radius_bound(flat, 5):.4f} m by (6)",
            f"{geometry.measured_robot_radius(flat, 5):.4f} m measured, {simulated:.4f} m simulated",
            "above (6); simulated within 2 %",
            bool(abs(simulated / geometry.measured_robot_radius(flat, 5) - 1) < 0.02),
            "1.51 times as large",
        ),
        all_of(
            "(7): a sensor of that radius covers in one lap",
            "always",
            np.array(sensors) <= 1,
            "curves",
            f"the radius that is needed is {min(sensors):.2f} to {max(sensors):.2f} times that of (7); {count}",
        ),
        all_of(
            f"(7) on curve (16): every robot senses every cell within a lap, {lap:.1f} s",
            "yes",
            np.isfinite(swept.score("coverage_time_each")),
            "starts",
            f"r_s = {closed_forms.coverage_radius(flat):.3f} m; {needed:.3f} m would do. By (7), not the text above",
        ),
        at_most(
            "(8): largest distance of ring neighbours / 2 r_s, alpha by the rule",
            "at most 1",
            max(links),
            1 + 1e-9,
            digits=".6f",
            why=f"exactly 1 for odd N (smallest {links_odd.min():.6f}); {count}",
        ),
        Claim(
            "(8) simulated on curve (16)",
            "1",
            f"{undisturbed.score('spacing_factor').max():.5f}",
            "\N{PLUS-MINUS SIGN} 0.001",
            bool(abs(undisturbed.score("spacing_factor").max() - 1) < 1e-3),
        ),
    ]
    return Part(claims, [picture])
