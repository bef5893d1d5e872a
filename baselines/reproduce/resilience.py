"""Fig. 4 and Theorem 3: displacements from which a formation comes back."""

import numpy as np

from baselines.reproduce.claims import Claim, Part, all_of
from baselines.reproduce.drawing import BLUE, DARK, GREEN, ORANGE, RED, Sheet, draw_plane, draw_ring
from baselines.reproduce.episodes import BARE, Played, Player
from lissajous_env import scenario
from lissajous_env.theory import closed_forms
from lissajous_env.world.tally import RECOVERED

_FORMATIONS = ((5, 2), (7, 2), (7, 3), (8, 3), (10, 3), (10, 4), (15, 7))
"""N and p, with the narrowest and the widest intervals of (9)."""
_INSIDE = 9
"""Random displacements inside the interval, for each formation."""


def _displaced(
    player: Player, name: str, angle: float, duration: float, only_ends: bool = False, **overrides: object
) -> Played:
    bare = {**BARE, "task.duration": duration, "task.step": 0.25, "formation.displaced": ((0, float(angle)),)}
    return player.play("kuramoto", scenario(name, **bare | overrides), only_ends=only_ends)


def fig4(player: Player) -> Part:
    """Reproduce Fig. 4: the admissible displacement of one robot of ten."""
    made = scenario("perturbation").resolve()
    curve, n = made.curve, made.num_robots
    half = closed_forms.admissible_displacement(n, made.p)[1]
    inside = np.random.default_rng(player.seed).uniform(-half, half, 20)
    back = [_displaced(player, "perturbation", angle, 60, only_ends=True).returned[0] for angle in inside]
    outside = np.arange(1.02 * half, np.pi, 0.04)
    returned = np.array(
        [_displaced(player, "perturbation", angle, 60, only_ends=True).returned[0] for angle in outside]
    )
    leaves = float(outside[~returned][0])

    with Sheet("fig4", "Fig. 4   Ten robots, and how far one of them may be displaced", 7.2, 4.0) as sheet:
        left, right = sheet.figure.subplots(1, 2, width_ratios=(1.25, 1))
        draw_plane(left, curve, color=RED, ls=":", lw=0.9)
        gamma = made.alpha * made.equilibrium
        position = closed_forms.curve_point(curve, gamma)
        draw_ring(left, position, made.neighbours)
        around = made.alpha * np.linspace(-half, half, 200) + gamma[0]
        left.plot(*closed_forms.curve_point(curve, around).T, color=GREEN, lw=2.6, ls=(0, (2.2, 1)), zorder=3)
        left.plot(*position.T, "o", color=BLUE, ms=9, zorder=4)
        for robot, place in enumerate(position):
            left.annotate(f"{robot + 1}", place, ha="center", va="center", fontsize=6.5, color="white", zorder=5)
        keys = {"ls": "none", "marker": "o", "color": BLUE, "ms": 5}, {"color": RED, "ls": ":"}, {"color": ORANGE}
        words = "robots", "curve", "ring"
        for key, word in (*zip(keys, words, strict=True), ({"color": GREEN, "ls": "--", "lw": 2.4}, "(9) for robot 1")):
            left.plot([], [], label=word, **key)
        left.legend(loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=4, handlelength=1.6, columnspacing=1.2)

        cases = ((0.95 * half, GREEN, "inside"), (1.6 * half, BLUE, "outside"), (leaves, RED, "outside"))
        for angle, colour, word in cases:
            played = _displaced(player, "perturbation", angle, 60)
            right.plot(played.time, played.deviation[:, 0], color=colour, label=f"{angle:.2f} rad, {word} (9)")
        right.axhline(RECOVERED, color=DARK, lw=0.8, ls="--")
        right.annotate(f"{RECOVERED} rad: recovered", (60, 1.12 * RECOVERED), ha="right", fontsize=8, color=DARK)
        right.set_yscale("log")
        right.set_ylim(1e-3, 6)
        right.set_xlabel("time since the displacement [s]")
        right.set_ylabel("largest deviation from the equilibrium [rad]")
        right.legend(loc="center right", bbox_to_anchor=(1, 0.68), title="robot 1 displaced by", title_fontsize=8)
        picture = sheet.picture(
            f"N = 10, a = 7, b = 3, A = B = 5 m as in the paper; p = {made.p} and the ring 1, 2 ... 10 are "
            "chosen, with "
            f"which (9) is |displacement| < {half:.3f} rad. The condition is sufficient: simulated, the formation "
            "comes "
            f"back from up to {leaves - 0.04:.2f} rad and leaves for another equilibrium from {leaves:.2f} rad on."
        )
    claims = [
        all_of(
            f"displaced inside (9), |d| < {half:.3f} rad, the same equilibrium returns",
            "always",
            back,
            "random displacements",
            "p = 3 and K = 1 chosen; robots as points",
        ),
        Claim(
            "displaced outside (9) it need not return",
            "no guarantee",
            f"it leaves from {leaves:.2f} rad on",
            f"some |d| > {half:.3f} rad leaves",
            not returned.all(),
            f"(9) is sufficient only: it still returns up to {leaves - 0.04:.2f} rad, {leaves / half:.1f} times (9)",
        ),
    ]
    return Part(claims, [picture])


def theorem3(player: Player) -> Part:
    """Test Theorem 3: a robot that is displaced within (9) returns."""
    random = np.random.default_rng(player.seed)
    returned: list[bool] = []
    unmet, tried = 0, 0
    for n, p in _FORMATIONS:
        half = closed_forms.admissible_displacement(n, p)[1]
        # A formation takes longest where an eigenvalue of its linearisation is nearest to 0.
        slowest = -closed_forms.equilibrium_eigenvalues(n, p)[1]
        at_rest = {"robot.count": n, "formation.p": p, "formation.alpha": 1, "formation.start": "equilibrium",
                   "sensing.radius": 1.0}  # fmt: skip
        angles = [*random.uniform(-half, half, _INSIDE), *np.linspace(-3.1, 3.1, 21)]
        plays = [_displaced(player, "failure", d, 20 + 5 / slowest, True, **at_rest) for d in angles]
        back = np.array([played.returned[0] for played in plays])
        admissible = np.abs(angles) < half
        returned += list(back[admissible])
        unmet, tried = unmet + int(np.sum(back & ~admissible)), tried + int(np.sum(~admissible))
    why = f"{len(_FORMATIONS)} formations; {unmet} of {tried} displacements outside (9) return too: not necessary"
    outside = {"returned outside": unmet, "tried outside": tried}
    return Part([all_of("condition (9) suffices", "always returns", returned, "return", why, outside)])
