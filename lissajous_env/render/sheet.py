"""Contact sheets for papers and slides: pictures of an episode side by side, drawn by matplotlib."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle

from lissajous_env.episodes.recording import Recording
from lissajous_env.episodes.snapshot import Snapshot, thinned
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import View
from lissajous_env.render.plotting import own_settings
from lissajous_env.render.team import Team
from lissajous_env.render.times import flash_time
from lissajous_env.storage.files import replacing
from lissajous_env.theory import closed_forms
from lissajous_env.world.state import REMOVED, STUCK, WORKING
from lissajous_env.world.targets.motion import FLEEING

STILLS = {".png": "Software", ".svg": "Date", ".pdf": "CreationDate"}
"""Suffixes of a contact sheet, and the entry of such a file that would differ from one drawing to the next."""
_PICTURES = 6
_DENSITY = 200
"""Resolution of a PNG [px/inch]."""
_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 8,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "lissajous",  # the same recording makes the same file
    "pdf.fonttype": 42,
}
_WIDTH = 3.4
"""Width of a picture [inch], that of a column of a paper."""
_SMALLEST = 0.015
"""Least radius of a drawn robot [inch]."""
_MOST_CELLS = 200, 200
"""Limit on the drawn rows and columns of the grid."""


def save_sheet(recording: Recording, path: str | Path) -> None:
    """Write six pictures of a recording, from the first moment to the last, side by side, row by row.

    Args:
        recording: Recording to draw.
        path: File to write, in the format of its suffix; written under a temporary name, then renamed.

    Raises:
        ValueError: a suffix other than .png, .svg and .pdf.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in STILLS:
        raise ValueError(f"path must end in {', '.join(STILLS)}, got {path}")
    scenario = recording.scenario
    moments = sorted(set(np.linspace(0, len(recording) - 1, _PICTURES).round().astype(int).tolist()))
    extent = scenario.curve.half_width, scenario.curve.half_height
    columns = min(max(round(math.sqrt(len(moments) * extent[1] / extent[0])), 1), len(moments))
    rows = -(-len(moments) // columns)
    # Cars overshoot the rectangle; robots farther away than twice its size are omitted.
    furthest = np.abs(recording.position[moments][..., :2]).max(axis=(0, 1))
    margin = 1.25 * scenario.robot.radius + 0.1 * min(extent)
    half = np.clip(furthest, extent, np.multiply(2, extent)) + margin
    height = _WIDTH * half[1] / half[0] + 0.25
    with own_settings(_STYLE):
        figure = Figure(figsize=(_WIDTH * columns, height * rows + 0.3), layout="constrained")
        every = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes in every:
            axes.set_axis_off()
        for axes, moment in zip(every, moments, strict=False):
            axes.set(xlim=(-half[0], half[0]), ylim=(-half[1], half[1]), aspect="equal")
            _draw(axes, scenario, recording.snapshot(moment))
        figure.legend(handles=_signs(scenario), loc="outside lower left", ncols=6, frameon=False)
        with replacing(path) as temporary:
            # Without a date, identical drawings have identical files.
            figure.savefig(temporary, format=suffix[1:], dpi=_DENSITY, metadata={STILLS[suffix]: None})


def _draw(axes: Axes, scenario: Scenario, seen: Snapshot) -> None:
    step, curve = scenario.task.step, scenario.curve
    found = f"{np.count_nonzero(seen.found):,} of {np.count_nonzero(seen.appears_at <= seen.step):,}"
    targets = f", detected {found}" if scenario.target_capacity > 0 else ""
    axes.set_title(f"{seen.step * step:.3g} s{targets}, collisions {seen.collisions}", loc="left", fontsize=8)
    corner, size = (-curve.half_width, -curve.half_height), (2 * curve.half_width, 2 * curve.half_height)
    if scenario.task.grid is not None:
        idle = (seen.step - thinned(seen.sensed_at, _MOST_CELLS)) * step / (2 * scenario.detection_time_bound)
        colours = np.array(palette.GROUND) + np.clip(idle, 0, 1)[..., None] * np.subtract(palette.IDLE, palette.GROUND)
        extent = (corner[0], corner[0] + size[0], corner[1], corner[1] + size[1])
        axes.imshow(np.rint(colours).astype(np.uint8), extent=extent, origin="lower", zorder=0)
    rectangle = axes.add_patch(Rectangle(corner, *size, fill=False, ec=_colour(palette.EDGE), lw=0.8, zorder=1))
    discs = [Circle(tuple(place), scenario.sensing_radius) for place in seen.position[seen.status == int(WORKING), :2]]
    sensing = PatchCollection(discs, color=_colour(palette.SENSING), alpha=0.12, lw=0, zorder=3)
    axes.add_collection(sensing)
    sensing.set_clip_path(rectangle)
    lap = closed_forms.curve_point(scenario.driven, np.linspace(0, 2 * np.pi, min(200 * curve.oscillations, 20_000)))
    axes.plot(*lap.T[:2], color=_colour(palette.CURVE), lw=0.7 if curve.oscillations < 40 else 0.2, zorder=2)
    _draw_targets(axes, scenario, seen)
    _draw_robots(axes, scenario, seen)


def _draw_robots(axes: Axes, scenario: Scenario, seen: Snapshot) -> None:
    places, status = seen.position[:, :2], seen.status
    radius = max(scenario.robot.radius, _SMALLEST * np.ptp(axes.get_xlim()) / _WIDTH)
    there = status != int(REMOVED)
    if seen.trail is not None:
        steps, trail = seen.trail
        recent = trail[steps >= seen.step - Team(scenario, View.of(scenario)).trail_steps()]
        ways = list(recent[:, there].swapaxes(0, 1))
        axes.add_collection(LineCollection(ways, colors=[_colour(palette.ROBOT)], alpha=0.45, lw=1.2, zorder=4))
    shape = model_of(scenario.robot.kind).shape
    drop = np.array([[1.42, 0.0], *([np.cos(turn), np.sin(turn)] for turn in np.linspace(0.8, 2 * np.pi - 0.8, 30))])
    for i in np.flatnonzero(there):
        colour = _colour(palette.STUCK if status[i] == int(STUCK) else palette.ROBOT)
        cos, sin = np.cos(seen.heading[i]), np.sin(seen.heading[i])
        axes.add_patch(Circle(tuple(places[i]), radius, fill=False, ec=colour, lw=0.5, alpha=0.6, zorder=5))
        for outline, fill in [(drop, None)] if shape is None else shape(scenario.robot):
            points = places[i] + radius * np.asarray(outline) @ np.array([[cos, sin], [-sin, cos]])
            axes.add_patch(Polygon(points, fc=_colour(getattr(palette, fill)) if fill else colour, lw=0, zorder=6))
        if scenario.num_robots <= 40:
            axes.annotate(str(i), tuple(places[i]), (4, 4), textcoords="offset points", fontsize=6, zorder=9)
    gone = places[~there]
    axes.plot(*gone.T, "x", color=_colour(palette.REMOVED), ms=5, zorder=5)
    for i, j in seen.contact:
        reach = float(np.linalg.norm(places[i] - places[j])) / 2 + 1.5 * radius
        middle = tuple((places[i] + places[j]) / 2)
        axes.add_patch(Circle(middle, reach, fill=False, ec=_colour(palette.CONTACT), lw=1.2, zorder=8))


def _draw_targets(axes: Axes, scenario: Scenario, seen: Snapshot) -> None:
    places, flees = seen.target_position, seen.motion == int(FLEEING)
    size = 2.5 if scenario.target_capacity < 1000 else 1.0
    # Thousands of targets are rasterized to limit the size of the file.
    dots: dict[str, Any] = {"ls": "", "ms": size, "zorder": 7, "rasterized": scenario.target_capacity > 5000}
    found = seen.found
    if scenario.targets.leave:
        found = found & (seen.step - seen.found_at < flash_time(scenario) / scenario.task.step)
    axes.plot(*places[found].T, marker="o", mfc="none", mec=_colour(palette.FOUND), mew=0.8, **dots)
    axes.plot(*places[seen.present & ~flees].T, marker="o", color=_colour(palette.TARGET), mew=0, **dots)
    axes.plot(*places[seen.present & flees].T, marker="o", mfc="white", mec=_colour(palette.TARGET), mew=0.7, **dots)


def _signs(scenario: Scenario) -> list[Line2D]:
    """Return the entries of the legend."""

    def sign(words: str, colour: palette.Colour, **line: Any) -> Line2D:
        return Line2D([], [], color=_colour(colour), label=words, ls="", marker="o", ms=4, **line)

    signs = [sign("robot", palette.ROBOT)]
    if scenario.faults.schedule or scenario.faults.rate > 0:
        signs.append(sign("failed robot", palette.STUCK))
    if scenario.target_capacity > 0:
        signs.append(sign("target", palette.TARGET))
        if scenario.targets.fleeing > 0:
            signs.append(sign("fleeing target", palette.TARGET, mfc="white"))
        signs.append(sign("detected just now" if scenario.targets.leave else "detected", palette.FOUND, mfc="none"))
    return signs


def _colour(colour: palette.Colour) -> tuple[float, float, float]:
    """Convert a colour of the palette for matplotlib."""
    red, green, blue = colour
    return red / 255, green / 255, blue / 255
