"""Problem 1 against rogues that can think: any motion at all, with all knowledge of what the robots will do."""

import math

from baselines.reproduce.claims import SILENT, Part, at_most, reported
from baselines.reproduce.episodes import Player
from lissajous_env.episodes.guarantee import critical_speed, fastest_rogue, guaranteed_time
from lissajous_env.parameters import named

_SPEEDS = (0.2, 1.0, 5.0)
"""Speeds of the evading targets [m/s]."""
_SHARES = (0.9, 0.8, 0.6)
"""Sensing radii, in that of (8)."""


def rogues(player: Player) -> Part:
    """Compute the worst-case undetected time of the formation, with the sensing radius of (8) and with shorter ones."""
    claims = []
    for name in ("experiment", "ideal"):
        scenario = named.scenario(name)
        words = f"N = {scenario.num_robots}, a = {scenario.curve.a}, b = {scenario.curve.b}"
        times = [guaranteed_time(scenario, scenario.detection_radius, speed) for speed in _SPEEDS]
        claims.append(
            at_most(
                f"{words}, r_s of (8): longest time unseen, rogues of 0.2, 1 and 5 m/s",
                f"T_max = {scenario.detection_time_bound:.3g} s",
                max(times),
                scenario.detection_time_bound,
                "s",
                why="the paper shows random walkers; this is the worst of all motions, detection between steps with it",
            )
        )
        fastest = fastest_rogue(scenario)
        found = {share: critical_speed(scenario, share * scenario.detection_radius) for share in _SHARES}
        shown = ", ".join(
            f"{speed:.2g} m/s at {share:g}" if speed < math.inf else f"above {fastest:.2g} m/s at {share:g}"
            for share, speed in found.items()
        )
        claims.append(
            reported(
                f"{words}, shorter sensors: how fast a rogue must be to stay undetected for ever, "
                "by r_s over that of (8)",
                SILENT,
                shown,
                why="below (8) the discs separate, but the formation still detects every rogue up to a speed",
                numbers={f"critical speed at {share:g}": min(speed, fastest) for share, speed in found.items()},
            )
        )
    return Part(claims)
