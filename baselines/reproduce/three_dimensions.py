"""Fig. 5 and Section IV-A: a curve in space, on which robots of a larger radius avoid collisions in a transient."""

import dataclasses

import numpy as np
from scipy.ndimage import generate_binary_structure, minimum_filter

from baselines.reproduce.claims import Claim, Part, all_of, at_most
from baselines.reproduce.drawing import DARK, SERIES, sheet
from baselines.reproduce.episodes import SEEDS, Player
from lissajous_env import scenario
from lissajous_env.parameters.scenario import Curve
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.world.columns import COLLISIONS, SEPARATION

_SHOWN = (1, 3, 5, 7, 11, 13)
"""c of Fig. 5; 3 shares a factor with a."""


def branch_radius(curve: Curve) -> float:
    """Return half of the smallest distance between two branches of the curve (10) [m]; 0 if it crosses itself.

    Smaller bodies cannot collide anywhere, unless one drives into the body before it on its own branch. Every local
    minimum over u and v of the distance between r(u - v) and r(u + v), v away from 0 and pi, is such a place.
    """
    most = max(curve.a, curve.b, curve.c if curve.half_depth > 0 else 1)
    u = np.linspace(0, np.pi, 24 * most, endpoint=False)
    v = np.linspace(0, np.pi, 24 * most + 1)[1:-1]
    u, v = np.meshgrid(u, v, indexing="ij")
    d = geometry.chord_length(curve, u, v)
    # r(u - v), r(u + v) is the same pair as with u + pi, pi - v.
    around = np.concatenate([d[-1:, ::-1], d, d[:1, ::-1]])
    local = d == minimum_filter(around, footprint=generate_binary_structure(2, 1), mode="nearest")[1:-1]
    local[:, [0, -1]] = False
    u, v, size = u[local], v[local], np.pi / (24 * most)
    offsets = np.stack(np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-1, 1, 7)), axis=-1).reshape(-1, 2)
    for _ in range(14):
        near_u, near_v = u[:, None] + size * offsets[:, 0], v[:, None] + size * offsets[:, 1]
        best = np.argmin(geometry.chord_length(curve, near_u, near_v), axis=1)
        u, v = near_u[np.arange(len(u)), best], near_v[np.arange(len(v)), best]
        size /= 2
    return float(geometry.chord_length(curve, u, v).min(initial=np.inf)) / 2


def fig5(player: Player) -> Part:
    """Reproduce Fig. 5: the largest body against c and C."""
    plane, body = scenario("failure").curve, scenario("experiment").robot.radius
    n = plane.a + plane.b
    depths = np.linspace(0, 1.6, 33)
    formation, branches = {}, {}  # largest body [m] by c, at each depth
    for c in _SHOWN:
        curves = [dataclasses.replace(plane, half_depth=float(C), c=c) for C in depths]
        formation[c] = np.array([geometry.smallest_distance(curve, n) / 2 for curve in curves])
        branches[c] = np.array([branch_radius(curve) for curve in curves])
    flat, bound = geometry.smallest_distance(plane, n) / 2, closed_forms.robot_radius_bound(plane, n)

    title = "Fig. 5   Largest body that never collides, against c and C of the curve in space"
    with sheet("fig5", title, 7.2, 3.6) as picture:
        left, right = picture.figure.subplots(1, 2, sharex=True, sharey=True)
        for c, colour in zip(_SHOWN, SERIES, strict=False):
            line = {"color": colour, "lw": 1.6, "ls": "--" if c == 3 else "-"}
            left.plot(depths, formation[c], label=f"{c}", **line)
            right.plot(depths, branches[c], **line)
        left.set_title("in formation, on equilibrium (2)")
        right.set_title("between two branches of the curve")
        right.axhline(body, color=DARK, lw=0.9, ls=":", label=f"body in Section VII, {body:g} m")
        for axes in (left, right):
            axes.set(xlabel="C, half of the extent along z [m]", xlim=(0, depths[-1]), ylim=(0, None))
        right.legend(loc="upper left")
        left.set_ylabel("$r_{max}$ [m]")
        left.add_artist(left.legend(title="c", ncols=3, loc="upper left", handlelength=1.6))
        (measured,) = left.plot([0], [flat], "o", color=DARK, ms=4.5, zorder=5, clip_on=False)
        measured.set_label(f"plane, measured: {flat:.3f} m")
        by_bound = left.axhline(bound, color=DARK, lw=0.9, ls="-.", label=f"plane, (6): {bound:.3f} m")
        left.legend(handles=[measured, by_bound], ncols=2, loc="lower left", fontsize=7.5,
                    handlelength=1.6, columnspacing=1, borderaxespad=0.1)  # fmt: skip
        picture.caption = (
            f"A = {plane.half_width:g} m, B = {plane.half_height:g} m, a = {plane.a}, b = {plane.b}, N = {n} (curve "
            "(16)); the paper does not state its curve. Left: half of the smallest distance that robots of the "
            "formation ever have. Right: half of the smallest distance between two branches of the curve, a bound for "
            "transients, in which robots may be anywhere; 0 in the plane, as the curve crosses itself, and for c = 3 "
            "(dashed), which shares a factor with a."
        )
    at_zero = max(abs(formation[c][0] - flat) for c in _SHOWN)
    monotone = [bool(np.all(np.diff(formation[c]) > -1e-9)) for c in _SHOWN]
    coprime = [c for c in _SHOWN if c != 3]
    free = [bool((branches[c][1:] > 1e-6).all()) for c in coprime]
    best = max(_SHOWN, key=lambda c: formation[c][-1])
    yield at_most(
        "at C = 0 the largest body is that of the plane curve: difference",
        "0",
        at_zero,
        1e-9,
        "m",
        f"{flat:.4f} m, measured; (6) promises {bound:.4f} m",
    )
    yield all_of(
        "r_max does not fall with C, whatever c",
        "curves rise",
        monotone,
        "values of c",
        f"to {formation[best][-1]:.3f} m at C = {depths[-1]:g} m, c = {best}. The paper does not state its curve; "
        "this is curve (16)",
    )
    yield all_of(
        "co-prime a, b, c: the curve does not cross itself for any C > 0",
        "never",
        free,
        "values of c",
        "one of b and c must be even too, here b = 2",
    )
    yield Claim(
        "c that shares a factor with a (3, 2, 3): the curve crosses itself",
        "not excluded",
        f"r_max = {branches[3].max():.3f} m",
        "0 m",
        bool(branches[3].max() < 1e-6),
        "co-prime in pairs is needed",
    )
    yield picture


def knot(player: Player) -> Part:
    """Simulate a transient of Section IV-A that collides in the plane and not on a knot."""
    turned = {"formation.start": "rotated"}
    flat = player.play("kuramoto", scenario("failure", **turned), worlds=SEEDS)
    deep = player.play("kuramoto", scenario("knot", **turned), worlds=SEEDS)
    curve, limit = deep.scenario.curve, 2 * deep.scenario.robot.radius
    colliding = int((flat.score(COLLISIONS) > 0).sum())
    yield Claim(
        "in the plane a transient can collide, although the condition of Theorem 4 is met",
        "cannot be ensured",
        f"{colliding} of {SEEDS} starts collide, down to {flat.score(SEPARATION).min():.3f} m",
        "at least one",
        colliding > 0,
        f"bodies of {limit / 2} m, the {SEEDS} starts of Fig. 6",
    )
    yield all_of(
        "on a knot the same transient does not",
        "avoids collisions",
        deep.score(COLLISIONS) == 0,
        "starts",
        f"smallest distance {deep.score(SEPARATION).min():.3f} m; C = {curve.half_depth:g} m, c = {curve.c} chosen",
    )
