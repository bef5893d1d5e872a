"""Drawings of the concepts, from the package's formulas and from episodes."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

import baselines
import lissajous_env
from baselines.benchmark.plot_styles import BLUE, DARK, GREEN, ORANGE, PINK, RED
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory import closed_forms
from lissajous_env.world.contamination.labels import introduced_at
from lissajous_env.world.state import NEVER

TEAM = (BLUE, RED, GREEN, PINK, ORANGE)
"""Colours of five robots."""
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "svg.hashsalt": "lissajous",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
}
_STEP, _SEED = 0.01, 2
"""Time step of the integration of (1) in a drawing [s]; seed of its initial phases."""


def drawn(draw: Callable[[Figure], None], width: float, height: float) -> bytes:
    """Return a figure as SVG, with reproducible bytes."""
    with rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
        draw(figure)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def curve() -> bytes:
    """Draw the curve with five robots in formation, their sensing discs and their ring."""
    scenario = lissajous_env.scenario("failure")
    return drawn(lambda figure: _draw_formation(figure.subplots(), scenario), 7.2, 3.5)


def _draw_formation(axes: Axes, scenario: Scenario) -> None:
    phases = scenario.equilibrium + 0.35
    places = closed_forms.curve_point(scenario.curve, scenario.alpha * phases)
    line = closed_forms.curve_point(scenario.curve, np.linspace(0, 2 * np.pi, 800))
    width, height = scenario.curve.half_width, scenario.curve.half_height
    axes.add_patch(Rectangle((-width, -height), 2 * width, 2 * height, fill=False, color=DARK, linewidth=1))
    axes.plot(*line.T, color="#9fb0c4", linewidth=1.4)
    for robot, place in enumerate(places):
        colour = TEAM[robot]
        axes.add_patch(Circle(place, scenario.sensing_radius, color=colour, alpha=0.07, linewidth=0))
        axes.add_patch(Circle(place, scenario.robot.radius, color=colour))
        axes.annotate(str(robot), place, color="white", ha="center", va="center", weight="bold")
        after = places[scenario.neighbours[robot, 1]]
        axes.plot(*np.stack([place, after]).T, color=DARK, linewidth=0.8, linestyle=(0, (4, 3)), zorder=0)
    axes.set(aspect="equal", xlim=(-1.35 * width, 1.35 * width), ylim=(-1.5 * height, 1.5 * height))
    title = f"a:b = {scenario.curve.a}:{scenario.curve.b}, N = a + b = {scenario.num_robots}"
    axes.set(xlabel="x [m]", ylabel="y [m]", title=title)


def ring() -> bytes:
    """Draw the phases on the circle, and the convergence of five random phases to the equilibrium."""
    scenario = lissajous_env.scenario("failure")

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1, 2))
        _draw_circle(left, scenario)
        _draw_transient(right, scenario)

    return drawn(draw, 7.2, 2.9)


def _draw_circle(axes: Axes, scenario: Scenario) -> None:
    places = np.stack([np.cos(scenario.equilibrium), np.sin(scenario.equilibrium)], axis=-1)
    axes.add_patch(Circle((0, 0), 1, fill=False, color="#9fb0c4", linewidth=1.4))
    for robot, place in enumerate(places):
        after = places[scenario.neighbours[robot, 1]]
        axes.annotate("", after, place, arrowprops={"arrowstyle": "-", "color": DARK, "linestyle": (0, (4, 3))})
        axes.add_patch(Circle(place, 0.14, color=TEAM[robot], zorder=3))
        axes.annotate(str(robot), place, color="white", ha="center", va="center", weight="bold", zorder=4)
    axes.set(aspect="equal", xlim=(-1.25, 1.25), ylim=(-1.25, 1.25), title=f"equilibrium, p = {scenario.p}")
    axes.axis("off")


def _draw_transient(axes: Axes, scenario: Scenario) -> None:
    rate, coupling = scenario.formation.phase_rate / scenario.alpha, scenario.coupling
    phases, history = np.random.default_rng(_SEED).uniform(0, 2 * np.pi, scenario.num_robots), []
    times = np.arange(0, 12, _STEP)
    for _ in times:
        history.append(phases)
        phases = phases + _STEP * closed_forms.kuramoto_rates(phases, scenario.neighbours, rate, coupling)
    ahead = np.array(
        [[phases[after] - phases[robot] for robot, (_, after) in enumerate(scenario.neighbours)] for phases in history]
    )
    for robot, lead in enumerate(np.mod(ahead, 2 * np.pi).T):
        jumps = np.where(np.abs(np.diff(lead, prepend=lead[0])) > np.pi, np.nan, lead)
        axes.plot(times, jumps, color=TEAM[robot], label=f"robot {robot}")
    settled = 2 * np.pi * scenario.p / scenario.num_robots
    axes.axhline(settled, color=DARK, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.set(xlabel="time [s]", ylabel="phase difference to the next robot [rad]", ylim=(0, 2 * np.pi))
    axes.set_title("from a random start, all differences become 2 pi p / N")


def recovery() -> bytes:
    """Draw the phase error of the paper's method and of open-loop control while two of five robots stop."""
    scenario = lissajous_env.scenario("failure")

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for _, start, end in scenario.faults.schedule[:1]:
            axes.axvspan(start, end, color="#eeeeee", label="two robots stop")
        for policy, colour in (("kuramoto", BLUE), ("open-loop", RED)):
            axes.plot(*_phase_error(scenario, policy), color=colour, label=policy)
        axes.set(xlabel="time [s]", ylabel="phase error [rad]", xlim=(0, scenario.task.duration), ylim=(0, None))
        axes.legend(frameon=False, ncols=3, loc="upper left")

    return drawn(draw, 7.2, 2.6)


def _phase_error(scenario: Scenario, name: str) -> tuple[np.ndarray, np.ndarray]:
    simulation, policy = lissajous_env.Simulation(scenario), baselines.make(name, scenario)
    errors = []
    for _ in range(scenario.task.steps):
        simulation.step(policy.act(simulation.observation))
        errors.append(simulation.tally.phase_error.numpy()[0])
    return scenario.task.step * (1 + np.arange(len(errors))), np.array(errors)


def guarantee() -> bytes:
    """Draw the area in which a rogue may hide while cars with the paper's method clear the rectangle."""
    scenario = lissajous_env.scenario("evaders")

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 3, sharey=True)
        simulation, policy = lissajous_env.Simulation(scenario, seed=1), baselines.make("kuramoto-mpcc", scenario)
        for axes, moment in zip(panels, (0.5, 2.0, 20.0), strict=True):
            while simulation.clock.step.numpy()[0] * scenario.task.step < moment - 1e-6:
                simulation.step(policy.act(simulation.observation))
            shown = _draw_field(axes, simulation, moment)
        panels[0].set_ylabel("y [m]")
        figure.colorbar(shown, ax=panels, shrink=0.7, label="undetected for [s]")

    return drawn(draw, 9.6, 2.1)


def _draw_field(axes: Axes, simulation: lissajous_env.Simulation, moment: float) -> Any:
    scenario = simulation.scenario
    width, height, since = scenario.curve.half_width, scenario.curve.half_height, introduced_at(simulation)
    age = np.where(since < int(NEVER), moment - since * scenario.task.step, np.nan)
    extent = (-width, width, -height, height)
    shown = axes.imshow(age, origin="lower", extent=extent, cmap="cividis_r", vmin=0, vmax=4, interpolation="nearest")
    for robot, place in enumerate(simulation.robots.position.numpy()[0, :, :2]):
        axes.add_patch(Circle(place, scenario.robot.radius, color=TEAM[robot], zorder=3))
    axes.set(aspect="equal", xlim=extent[:2], ylim=extent[2:], title=f"{moment:g} s", xlabel="x [m]")
    return shown


DRAWINGS = {"curve": curve, "ring": ring, "recovery": recovery, "guarantee": guarantee}
"""Functions that make the drawings, by name."""
