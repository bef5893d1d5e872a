"""The robots: cars or discs to scale, their trails, the communication ring, failures and collisions."""

import numpy as np
import pygame

from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE, View, transparent, within
from lissajous_env.render.text import write, write_outlined
from lissajous_env.render.times import trail_time
from lissajous_env.world.state import REMOVED, STUCK, WORKING

MOST_CONTACTS = 2000
"""Contacts that are ringed at most; a crowd in one heap has hundreds of thousands."""
_FARTHEST = 1e6
"""Distance from the picture beyond which it is of no matter where a link ends [px of the fine surface]."""


class Team:
    """Draws the robots of one scenario, enlarged if they would be too small."""

    def __init__(self, scenario: Scenario, view: View):
        self.scenario, self.view = scenario, view
        self.many = scenario.num_robots > 40
        """True for a crowd, which is drawn small and without numbers."""
        smallest = 3.6 if self.many else 6.5
        self.radius = max(view.scale * scenario.robot.radius, smallest)
        """Radius with which a robot is drawn [px]."""
        shape = model_of(scenario.robot.kind).shape
        self._inside = self.radius > (8.5 if shape is None else 17)
        self._number_size = round(min(0.3 * self.radius + 8, 17))
        self._room = view.plot()
        self._around = self._room.inflate(2 * self._room.width, 2 * self._room.height)
        ring = scenario.ring
        self._edges = [(ring[k - 1], ring[k]) for k in range(len(ring)) if len(ring) > 2 or k == 1]
        self._soft = transparent(view.fine_size)
        fine = FINE * self.radius
        self._drop, self._rim = _drop(fine, 1.42 * fine), _drop(fine + 1.3 * FINE, 1.42 * fine + 2.1 * FINE)
        parts = [] if shape is None else shape(scenario.robot)
        self._parts = [(fine * outline, getattr(palette, fill) if fill else None) for outline, fill in parts]

    def trail_steps(self) -> int:
        """Return the length of a trail [step]."""
        longest = trail_time(self.scenario) * (0.2 if self.many else 1.0)
        return max(round(min(longest / self.scenario.task.step, 2**20)), 2)

    def draw_links(self, surface: pygame.Surface, snapshot: Snapshot, steps: np.ndarray, trail: np.ndarray) -> None:
        """Draw the communication ring and the trails, positions (K, N, 2) at K steps, below the robots."""
        soft, there = self._soft, snapshot.status != int(REMOVED)
        soft.fill((0, 0, 0, 0))
        places = self.view.fine(snapshot.position[:, :2])
        ends = np.clip(places, -_FARTHEST, _FARTHEST).tolist()
        for i, j in self._edges:
            # pygame iterates over the whole line, even if only a little of it is visible.
            if there[i] and there[j] and (seen := self._room.clipline(ends[i], ends[j])):
                pygame.draw.line(soft, (*palette.LINK, 84), *seen, FINE)
        # Drawn without blending, oldest first, so that joints do not appear darker.
        width = 0.42 * min(FINE * self.radius, 8 * FINE)
        for k in range(len(steps) - 1):
            fresh = 1 - (snapshot.step - steps[k + 1]) / (self.trail_steps() + 1)
            colour, thick = (*palette.ROBOT, round(150 * fresh**1.5)), max(width * (0.35 + 0.65 * fresh), 2)
            before, after = self.view.fine(trail[k]), self.view.fine(trail[k + 1])
            shown = there & within(before, self._around) & within(after, self._around)
            for a, b in zip(before[shown], after[shown], strict=True):
                pygame.draw.line(soft, colour, a, b, round(thick))
                pygame.draw.circle(soft, colour, b, thick / 2)
        surface.blit(soft, (0, 0))

    def draw(self, surface: pygame.Surface, snapshot: Snapshot) -> None:
        """Draw the robots, highest last, their numbers, and rings around colliding pairs."""
        places = self.view.fine(snapshot.position[:, :2])
        status, inside = snapshot.status, within(places, self._room)
        order = sorted(range(len(places)), key=lambda i: (status[i] != int(REMOVED), snapshot.position[i, 2]))
        for i in order:
            colour = palette.ROBOT if status[i] == int(WORKING) else palette.STUCK
            if not inside[i]:
                self._point_out(surface, i, places[i], palette.REMOVED if status[i] == int(REMOVED) else colour)
                continue
            if status[i] == int(REMOVED):
                self._draw_removed(surface, places[i])
                continue
            if status[i] == int(STUCK):
                _dashed_ring(surface, palette.STUCK, places[i], FINE * (1.15 * self.radius + 4), 2 * FINE)
            if not self._parts:
                self._draw_point(surface, places[i], snapshot.heading[i], colour)
            else:
                self._draw_parts(surface, places[i], snapshot.heading[i], colour)
        for i, j in snapshot.contact[:: -(-len(snapshot.contact) // MOST_CONTACTS) or 1]:
            middle, apart = (places[i] + places[j]) / 2, float(np.linalg.norm(places[i] - places[j]))
            # Robots in contact are close; a recording may be inconsistent.
            reach = min(apart / 2, 2 * FINE * self.radius) + FINE * (1.1 * self.radius + 3)
            if within(middle, self._around):
                pygame.draw.circle(surface, palette.CONTACT, middle, max(reach, 12 * FINE), 2 * FINE)
        for i in order:
            if inside[i] and not self.many:
                self._draw_number(surface, i, places[i], gone=status[i] == int(REMOVED))

    def _draw_point(self, surface: pygame.Surface, at: np.ndarray, heading: float, colour: palette.Colour) -> None:
        pygame.draw.polygon(surface, palette.GROUND, (at + _turned(self._rim, heading)).tolist())
        pygame.draw.polygon(surface, colour, (at + _turned(self._drop, heading)).tolist())

    def _draw_parts(self, surface: pygame.Surface, at: np.ndarray, heading: float, colour: palette.Colour) -> None:
        # Collisions use the disc around the position, so the body is centred there.
        pygame.draw.circle(surface, palette.mixed(palette.GROUND, colour, 0.45), at, FINE * self.radius, FINE)
        for shape, fill in self._parts:
            pygame.draw.polygon(surface, colour if fill is None else fill, (at + _turned(shape, heading)).tolist())

    def _point_out(self, surface: pygame.Surface, robot: int, at: np.ndarray, colour: palette.Colour) -> None:
        """Mark a robot outside the picture by an arrow at the edge."""
        room = self._room.inflate(-26 * FINE, -26 * FINE)
        edge = np.clip(at, room.topleft, room.bottomright)
        away = (at - edge) / np.linalg.norm(at - edge)
        shape = _turned(_drop(4.5 * FINE, 10.0 * FINE), float(np.arctan2(-away[1], away[0])))
        pygame.draw.polygon(surface, colour, (edge + shape).tolist())
        if not self.many:
            x, y = edge / FINE - 14 * away
            write_outlined(surface, str(robot), (x, y), colour)

    def _draw_number(self, surface: pygame.Surface, robot: int, at: np.ndarray, gone: bool) -> None:
        """Write a robot's number on it, or beside it where it is small."""
        x, y = at / FINE
        if self._inside and not gone:
            write(surface, str(robot), (x, y), self._number_size, palette.GROUND, centred=True)
        else:
            away = 0.75 * self.radius + 6
            write_outlined(surface, str(robot), (x + away, y - away), palette.REMOVED if gone else palette.INK)

    def _draw_removed(self, surface: pygame.Surface, at: np.ndarray) -> None:
        radius = FINE * self.radius
        pygame.draw.circle(surface, palette.REMOVED, at, radius, 2 * FINE)
        for turn in (np.pi / 4, 3 * np.pi / 4):
            arm = 0.55 * radius * np.array([np.cos(turn), np.sin(turn)])
            pygame.draw.line(surface, palette.REMOVED, at - arm, at + arm, 2 * FINE)


def _turned(shape: np.ndarray, heading: float) -> np.ndarray:
    """Rotate points (k, 2) by a heading and flip y for the picture."""
    cos, sin = np.cos(heading), np.sin(heading)
    return shape @ np.array([[cos, -sin], [-sin, -cos]])


def _dashed_ring(surface: pygame.Surface, colour: palette.Colour, at: np.ndarray, radius: float, width: int) -> None:
    for start in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        arc = start + np.linspace(0, np.pi / 9, 8)
        points = at + radius * np.stack([np.cos(arc), np.sin(arc)], axis=-1)
        pygame.draw.lines(surface, colour, False, points.tolist(), width)


def _drop(radius: float, tip: float) -> np.ndarray:
    """Return the outline of a disc with a tip, whose sides are tangents."""
    touch = np.arccos(radius / tip)
    around = np.linspace(touch, 2 * np.pi - touch, 40)
    return np.concatenate([[[tip, 0.0]], radius * np.stack([np.cos(around), np.sin(around)], axis=-1)])
