"""The targets: dots while undetected, and a widening, fading ring after detection.

Targets that stay after their detection are green while they are in sight. Where targets are seen before they are
detected, those out of sight are pale.
"""

import math

import numpy as np
import pygame

from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE, View, stamp
from lissajous_env.world.targets.motion import FLEEING

SHADES = 20
"""Number of ages of a detection that are drawn differently."""

SMALL = 2.2 * FINE
"""Radius up to which a dot has no room for anything around it [px of the fine surface]."""


class Targets:
    """Draws the targets of one scenario, all targets of a kind at once for speed."""

    def __init__(self, scenario: Scenario, view: View):
        self.view, self.scenario = view, scenario
        rectangle = view.rectangle()
        usual = scenario.targets.count + scenario.targets.arrival_rate * scenario.detection_time_bound
        apart = math.sqrt(rectangle.width * rectangle.height / max(usual, 1.0)) / FINE
        self.radius = float(np.clip(0.2 * apart, 1.35, 4.0))
        """Radius of a dot [px]."""
        self._flash_steps = flash_time(scenario) / scenario.task.step

    def draw(self, surface: pygame.Surface, snapshot: Snapshot) -> None:
        """Draw the targets that are present, and recent detections."""
        scenario, places, detected = self.scenario, self.view.fine(snapshot.target_position), snapshot.detected
        age = (snapshot.step - snapshot.found_at) / self._flash_steps
        recent = np.flatnonzero(detected & (age < 1))
        shade = np.floor(SHADES * age[recent] + 1e-6) / SHADES
        for level in np.unique(shade):
            draw_flash(surface, places[recent[shade == level]], FINE * self.radius, float(level))
        stays = not scenario.targets.leave
        present = snapshot.present | (detected & stays)
        seen = snapshot.in_sight(scenario.sight) if has_sightings(scenario) else present
        fleeing = snapshot.motion == FLEEING
        colours = (palette.TARGET, palette.DETECTED) if stays else (palette.UNSEEN, palette.TARGET)
        for is_seen, colour in enumerate(colours):
            for flees in (False, True):
                chosen = present & (seen == is_seen) & (fleeing == flees)
                draw_dots(surface, places[chosen], FINE * self.radius, flees, colour)


def has_sightings(scenario: Scenario) -> bool:
    """Return whether targets are in sight for longer than the moment of their detection."""
    return not scenario.targets.leave or scenario.sight > scenario.sensing_radius


def draw_dots(
    surface: pygame.Surface, points: np.ndarray, radius: float, flees: bool, colour: palette.Colour = palette.TARGET
) -> None:
    """Draw targets; fleeing targets have a light core."""
    if radius > SMALL:
        stamp(surface, points, radius + FINE, palette.GROUND, alpha=0.85)
    stamp(surface, points, radius, colour)
    if flees:
        stamp(surface, points, 0.45 * radius, palette.GROUND)


def draw_flash(surface: pygame.Surface, points: np.ndarray, radius: float, age: float) -> None:
    """Draw detections of an age in [0, 1): a fading dot and, if there is space, a widening ring."""
    fading = 1.0 - age
    if radius > SMALL:
        outer = radius * (1.3 + 2.1 * age)
        stamp(surface, points, outer, palette.DETECTED, hole=outer - 0.45 * radius, alpha=fading)
    stamp(surface, points, 0.9 * radius, palette.DETECTED, alpha=fading**1.5)


def flash_time(scenario: Scenario) -> float:
    """Return the time for which a detection is shown [s]: a quarter of T_max, at most a twentieth of the episode."""
    task = scenario.task
    return max(min(scenario.detection_time_bound / 4, task.duration / 20), task.step)
