"""Fig. 7 and 8: five cars, two of which fail and resume."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from baselines.reproduce.claims import Claim, Part, all_of, at_most, reported, span
from baselines.reproduce.drawing import (
    BLUE,
    DARK,
    GREY,
    ORANGE,
    PINK,
    draw_plane,
    draw_ring,
    mark_time,
    name_line,
    sheet,
)
from baselines.reproduce.episodes import SEEDS, EpisodeArrays, Player, phase_distance, spread_of_cars
from lissajous_env.world.columns import COLLISIONS

_SIMULATED = (0, 4)
"""Robots 1 and 5, which were simulated in the paper's experiment and failed."""
_STILLS = (0.0, 8.0, 16.0, 24.5, 34.4, 35.5, 37.5, 42.0)
"""Times of the stills (a) to (h) [s]: the failure begins at (d) and ends just after (e)."""


def fig7(player: Player) -> Part:
    """Reproduce Fig. 7: stills of the experiment."""
    played = player.play("kuramoto-mpcc", "experiment", worlds=SEEDS)
    scenario, step = played.scenario, played.scenario.task.step
    title = "Fig. 7   The experiment: five cars on curve (16), robots 1 and 5 fail at (d)"
    with sheet("fig7", title, 9.0, 4.0) as picture:
        for k, time in enumerate(_STILLS):
            axes = picture.figure.add_subplot(2, 4, k + 1)
            moment = round(time / step)
            axes.set_title(f"({'abcdefgh'[k]})  t = {time:.1f} s")
            draw_plane(axes, scenario.curve, lw=0.7, ls="--")
            draw_ring(axes, played.position[moment, 0, :, :2], scenario.neighbours, alpha=0.75)
            for robot in range(scenario.num_robots):
                _draw_car(axes, played, robot, moment)
            axes.set(xlim=(-2.35, 2.35), ylim=(-1.5, 1.5))
        picture.caption = (
            "Simulated agents pink, physical ones blue, as in the paper, with the way of the last 1.5 s; a thick "
            f"orange rim marks a robot that has failed; edges of the ring orange. {_chosen(played)}."
        )
    before, during, _ = _periods(played)
    deviation = played.deviation[before].max(axis=0)
    end = np.flatnonzero(during)[-1]  # the resume; in the second before it, stationary robots keep their phases
    drift = phase_distance(played.phase[end], played.phase[end - round(1 / step)]).max(axis=-1)
    yield at_most(
        f"(a)-(d) the formation is preserved: largest deviation of {SEEDS} seeds",
        "preserved",
        deviation.max(),
        0.2,
        "rad",
        "cars that cannot follow the tight turns always oscillate about it by this much",
    )
    yield Claim(
        "(e) another equilibrium, in which all agents are stationary",
        "stationary",
        f"{drift.max():.3f} rad in the last second before the resume",
        "below 0.01 rad",
        bool(drift.max() < 0.01),
        f"the worst car of {SEEDS} seeds; (1) requires no motion, and the cars coast to rest",
    )
    yield _returns(played, "(f)-(h) after the resume the previous equilibrium returns")
    yield picture


def fig8(player: Player) -> Part:
    """Reproduce Fig. 8: the phases in the same experiment."""
    played = player.play("kuramoto-mpcc", "experiment", worlds=SEEDS)
    first, last = played.scenario.faults.schedule[0][1:]
    with sheet("fig8", "Fig. 8   States of the agents in the experiment of Fig. 7", 7.2, 4.3) as picture:
        upper, lower = picture.figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        phase = np.unwrap(played.phase[:, 0], axis=0)
        for robot in range(played.scenario.num_robots):
            colour = PINK if robot in _SIMULATED else BLUE
            word = {0: "simulated agents, fail", 1: "physical agents"}.get(robot)
            upper.plot(played.time, phase[:, robot], color=colour, lw=1.4, label=word)
            name_line(upper, played.time[-1], phase[-1, robot], f"{robot + 1}", colour)
        lower.plot(played.time, played.deviation, color=GREY, lw=0.4)
        lower.plot(played.time, played.deviation[:, 0], color=BLUE, lw=1.4)
        for axes in (upper, lower):
            axes.axvspan(first, last, color=ORANGE, alpha=0.2, lw=0, label="failure")
            axes.set_xlim(0, played.time[-1])
        upper.legend(loc="lower right")
        for k, time in enumerate(_STILLS[:5]):
            mark_time(upper, time, f"({'abcde'[k]})", 0.98, "#777777")
        upper.set_ylabel("states $\\theta$ [rad]")
        lower.set(xlabel="time t [s]", ylabel="deviation\nfrom (2) [rad]", ylim=(0, None))
        picture.caption = (
            f"Above: one run, seed {player.seed}; below: its largest deviation from the equilibrium (blue) and "
            f"that of {SEEDS - 1} further seeds (grey). {_chosen(played)}."
        )
    collisions = played.score(COLLISIONS)
    yield _returns(played, "states return to the previous equilibrium, as in Fig. 6(a)")
    yield reported(
        "collisions in the transient",
        "not excluded (IV-A)",
        f"{span(collisions, 'g')} an episode",
        "waiting cars may stop anywhere on a curve that crosses itself: Theorem 4 does not cover bodies",
    )
    yield picture


def _chosen(played: EpisodeArrays) -> str:
    """Return the choices where the paper states no value, as sentences of a caption."""
    scenario = played.scenario
    first, last = scenario.faults.schedule[0][1:]
    return (
        f"The paper does not print when the agents fail; {first:g} s to {last:g} s is chosen. K = "
        f"{scenario.coupling:g}; all {scenario.num_robots} are cars here, which differ by {spread_of_cars(scenario)} "
        "in wheelbase and drive"
    )


def _periods(played: EpisodeArrays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return masks (F,) of the time before the failure, in it, and 8 s or more after it."""
    first, last = played.scenario.faults.schedule[0][1:]
    time = played.time
    return time < first, (time >= first) & (time < last), time >= last + 8


def _returns(played: EpisodeArrays, claim: str) -> Claim:
    """Claim that the formation deviates from 8 s after the resume on as little as before the failure."""
    before, _, after = _periods(played)
    most = 1.25 * played.deviation[before].max()
    why = f"from 8 s after the resume on within {most:.2f} rad, 1.25 times the swing before the failure"
    return all_of(claim, "yes", (played.deviation[after] < most).all(axis=0), "seeds", why)


def _draw_car(axes: Axes, played: EpisodeArrays, robot: int, moment: int) -> None:
    """Draw a car's disc, its heading, its number and its way of the last 1.5 s, in frame `moment` of world 0."""
    colour = PINK if robot in _SIMULATED else BLUE
    place, heading = played.position[moment, 0, robot, :2], played.heading[moment, 0, robot]
    steps = round(1.5 / played.scenario.task.step)
    way = played.position[max(moment - steps, 0) : moment + 1, 0, robot, :2]
    axes.plot(*way.T, color=colour, lw=1.6, alpha=0.55, zorder=3, solid_capstyle="round")
    rim: dict[str, Any] = {"ec": ORANGE, "lw": 2.2} if played.failed[moment, 0, robot] else {"ec": "white", "lw": 0.6}
    axes.add_patch(Circle((place[0], place[1]), played.scenario.robot.radius, fc=colour, zorder=4, **rim))
    nose = place + 0.24 * np.array([np.cos(heading), np.sin(heading)])
    axes.plot(*np.stack([place, nose]).T, color=DARK, lw=1.2, zorder=3.5, solid_capstyle="round")
    axes.annotate(f"{robot + 1}", (place[0], place[1]), ha="center", va="center", fontsize=6, color="white", zorder=5)
