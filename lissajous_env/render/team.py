"""The robots: cars or discs to scale, their trails, the communication ring, failures and collisions."""

import numpy as np
import pygame

from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE, View, draw_line, transparent, within, write_outlined
from lissajous_env.theory import closed_forms
from lissajous_env.world.state import FAILED, REMOVED, WORKING

MOST_CONTACTS = 2000
"""Limit on the contacts that are ringed; a crowd in one heap has hundreds of thousands."""
_COLOURS = {WORKING: palette.ROBOT, FAILED: palette.FAILED, REMOVED: palette.REMOVED}


class Team:
    """Draws the robots of one scenario, enlarged if they would be too small."""

    def __init__(self, scenario: Scenario, view: View):
        self.scenario, self.view = scenario, view
        self.many = scenario.num_robots > 40
        """True for a crowd, which is drawn small and without numbers."""
        self.radius = FINE * max(view.scale * scenario.robot.radius, 3.6 if self.many else 6.5)
        """Radius with which a robot is drawn [px of the fine surface]."""
        longest = trail_time(scenario) * (0.2 if self.many else 1.0)
        self.trail_steps = max(round(min(longest / scenario.task.step, 2**20)), 2)
        """Length of a trail [step]."""
        self._room = view.plot()
        self._links = drawn_links(scenario)
        self._soft = transparent(view.fine_size)
        parts = parts_of_body(scenario)
        self._parts = [(self.radius * outline, getattr(palette, fill) if fill else None) for outline, fill in parts]

    def draw_links(self, surface: pygame.Surface, snapshot: Snapshot, steps: np.ndarray, trail: np.ndarray) -> None:
        """Draw the communication ring and the trails, positions (K, N, 2) at K steps, below the robots."""
        soft, there = self._soft, snapshot.status != REMOVED
        soft.fill((0, 0, 0, 0))
        places = self.view.fine(snapshot.position[:, :2])
        for i, j in self._links:
            if there[i] and there[j]:
                draw_line(soft, (*palette.LINK, 84), places[i], places[j], FINE)
        # Drawn without blending, oldest first, so that joints do not appear darker.
        width = max(round(0.42 * min(self.radius, 8 * FINE)), 2)
        past = self.view.fine(trail)
        for k in range(len(steps) - 1):
            fresh = 1 - (snapshot.step - steps[k + 1]) / (self.trail_steps + 1)
            for i in np.flatnonzero(there):
                draw_line(soft, (*palette.ROBOT, round(150 * fresh**1.5)), past[k, i], past[k + 1, i], width)
        surface.blit(soft, (0, 0))

    def draw(self, surface: pygame.Surface, snapshot: Snapshot) -> None:
        """Draw the robots, highest last, their numbers, and rings around colliding pairs."""
        places, status = self.view.fine(snapshot.position[:, :2]), snapshot.status
        inside = within(places, self._room)
        order = sorted(range(len(places)), key=lambda i: (status[i] != REMOVED, snapshot.position[i, 2]))
        for i in order:
            if not inside[i]:
                self._point_out(surface, places[i], _COLOURS[int(status[i])])
            elif status[i] == REMOVED:
                pygame.draw.circle(surface, palette.REMOVED, places[i], self.radius, 2 * FINE)
            else:
                self._draw_body(surface, places[i], snapshot.heading[i], _COLOURS[int(status[i])])
        for i, j in snapshot.contact[:: -(-len(snapshot.contact) // MOST_CONTACTS) or 1]:
            middle, apart = (places[i] + places[j]) / 2, float(np.linalg.norm(places[i] - places[j]))
            if within(middle, self._room):
                # Robots in contact are close; a recording may be inconsistent.
                reach = min(apart / 2, 2 * self.radius) + 1.1 * self.radius + 3 * FINE
                pygame.draw.circle(surface, palette.CONTACT, middle, max(reach, 12 * FINE), 2 * FINE)
        for i in [] if self.many else np.flatnonzero(inside):
            x, y = (places[i] + (0.75 * self.radius + 6 * FINE) * np.array([1, -1])) / FINE
            write_outlined(surface, str(i), (x, y), palette.INK)

    def _draw_body(self, surface: pygame.Surface, at: np.ndarray, heading: float, colour: palette.Colour) -> None:
        # Collisions use the disc around the position, so the body is centred there.
        pygame.draw.circle(surface, palette.mixed(palette.GROUND, colour, 0.45), at, self.radius + FINE, FINE)
        for shape, fill in self._parts:
            pygame.draw.polygon(surface, colour if fill is None else fill, (at + _turned(shape, heading)).tolist())
        if colour == palette.FAILED:
            pygame.draw.circle(surface, colour, at, 1.15 * self.radius + 4 * FINE, 2 * FINE)

    def _point_out(self, surface: pygame.Surface, at: np.ndarray, colour: palette.Colour) -> None:
        """Mark a robot outside the picture by an arrow at the edge."""
        room = self._room.inflate(-26 * FINE, -26 * FINE)
        edge = np.clip(at, room.topleft, room.bottomright)
        right, down = at - edge
        shape = 4.5 * FINE * _turned(_drop(2.2), float(np.arctan2(-down, right)))
        pygame.draw.polygon(surface, colour, (edge + shape).tolist())


def parts_of_body(scenario: Scenario) -> list[tuple[np.ndarray, str | None]]:
    """Return the outlines (k, 2) of the parts of a robot of radius 1, each with its colour, None for the robot's."""
    shape = model_of(scenario.robot.kind).shape
    return [(_drop(1.42), None)] if shape is None else shape(scenario.robot)


def _turned(shape: np.ndarray, heading: float) -> np.ndarray:
    """Rotate points (k, 2) by a heading and flip y for the picture."""
    cos, sin = np.cos(heading), np.sin(heading)
    return shape @ np.array([[cos, -sin], [-sin, -cos]])


def _drop(tip: float) -> np.ndarray:
    """Return the outline of a disc of radius 1 with a tip, whose sides are tangents."""
    touch = np.arccos(1 / tip)
    around = np.linspace(touch, 2 * np.pi - touch, 40)
    return np.concatenate([[[tip, 0.0]], np.stack([np.cos(around), np.sin(around)], axis=-1)])


def drawn_links(scenario: Scenario) -> list[tuple[int, int]]:
    """Return the pairs of neighbours on the communication ring, or none if no policy communicates along it."""
    ring = scenario.ring if scenario.has_formation or scenario.sensing.shared == "ring" else ()
    return [(ring[k], ring[(k + 1) % len(ring)]) for k in range(len(ring) - (len(ring) < 3))]


def trail_time(scenario: Scenario) -> float:
    """Return the time in which a robot at nominal speed covers 0.55 of the rectangle's shorter side [s].

    A trail in a picture lasts as long, that of many robots a fifth of it, and that in a replay page twice as long.
    """
    lap = np.linspace(0, 2 * np.pi, 512)
    speed = scenario.formation.phase_rate * closed_forms.curve_speed(scenario.driven, lap).mean()
    return float(1.1 * min(scenario.curve.half_width, scenario.curve.half_height) / speed)
