"""The surroundings of the plot: the status line above, scale bar and legend below."""

import math

import numpy as np
import pygame

from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE, FOOTER, HEADER, MARGIN, View, width_of, write
from lissajous_env.render.targets import draw_dots, draw_flash, has_sightings

_GAP = 22
"""Space between entries [px]."""
_RAMP = 64
"""Width of the colour scale [px]."""


class Panel:
    """Draws the surroundings of one scenario's plot; entries that do not fit are omitted."""

    def __init__(self, scenario: Scenario, view: View, idle_full: float, dot: float):
        self.scenario, self.view, self.idle_full = scenario, view, idle_full
        width, height = view.size
        self.left, self.right = MARGIN, width - MARGIN
        self.large, self.medium, self.small = (19, 15, 13) if width >= 560 else (14, 12, 10)
        self._dot = FINE * min(max(dot, 2.4), 3.6)
        self._status_at, self._legend_at = HEADER // 2 - 3, height - FOOTER // 2 - 2
        self._bar = _round_length(0.16 * (self.right - self.left) / view.scale)

    def draw_fixed(self, fine: pygame.Surface) -> None:
        """Draw the constant parts: the scenario's name and the legend."""
        write(fine, self.scenario.name, (self.left, self._status_at), self.large, palette.INK)
        y, x = self._legend_at, float(self.left)
        for kind, indent, words in self._legend():
            if x + indent + width_of(words, self.small) > self.right:
                return
            self._draw_sign(fine, kind, x)
            x = write(fine, words, (x + indent, y), self.small, palette.MUTED) + _GAP

    def draw(self, fine: pygame.Surface, snapshot: Snapshot) -> None:
        """Draw the current numbers and the progress of the episode."""
        line = pygame.Rect(FINE * self.left, FINE * (HEADER - 6), FINE * (self.right - self.left), 2 * FINE)
        pygame.draw.rect(fine, palette.HAIRLINE, line)
        line.width = round(line.width * min(snapshot.step / self.scenario.task.steps, 1.0))
        pygame.draw.rect(fine, palette.ROBOT, line)
        entries, x = self._status(snapshot), float(self.right)
        room = self.right - self.left - width_of(self.scenario.name, self.large)
        while entries and sum(_GAP + width_of(words, self.medium) for words in entries) > room:
            entries.pop()
        for words in entries:
            alarm = words.startswith("collisions") and snapshot.collisions > 0
            write(fine, words, (x, self._status_at), self.medium, palette.CONTACT if alarm else palette.INK, "midright")
            x -= width_of(words, self.medium) + _GAP

    def _status(self, snapshot: Snapshot) -> list[str]:
        """Return the entries of the status line, the most important one first."""
        task = self.scenario.task
        decimals = decimals_of(task.step)
        time = f"{snapshot.step * task.step:.{decimals}f} of {task.duration:g} s"
        entries = [time, f"collisions {snapshot.collisions}"]
        if self.scenario.target_capacity > 0:
            if not self.scenario.targets.leave:
                in_sight = np.count_nonzero(snapshot.in_sight(self.scenario.sight))
                return [*entries, f"in sight {in_sight:,} of {snapshot.num_targets:,}"]
            entries.append(f"detected {snapshot.num_detected:,} of {snapshot.num_targets:,}")
            mean = snapshot.mean_detection_time(task.step)
            entries.append("mean detection time " + ("none" if math.isnan(mean) else f"{mean:.{decimals + 1}f} s"))
        return entries

    def _legend(self) -> list[tuple[str, float, str]]:
        """Return the entries of the legend: sign, width [px] and text."""
        entries = [("bar", self._bar * self.view.scale + 8, f"{self._bar:g} m")]
        if self.scenario.target_capacity > 0:
            entries.append(("target", 15.0, "target"))
            if self.scenario.targets.fleeing > 0:
                entries.append(("fleeing", 15.0, "evading target"))
            if has_sightings(self.scenario):
                leaves = self.scenario.targets.leave
                entries.append(("unseen", 15.0, "out of sight") if leaves else ("seen", 15.0, "in sight"))
            entries.append(("detected", 20.0, "detected"))
        if self.scenario.task.grid is not None:
            entries.append(("ramp", _RAMP + 8.0, f"not covered for {float(f'{self.idle_full:.2g}'):g} s or more"))
        return entries

    def _draw_sign(self, fine: pygame.Surface, kind: str, x: float) -> None:
        y = FINE * self._legend_at
        if kind == "bar":
            pygame.draw.rect(fine, palette.INK, (FINE * x, y - FINE, FINE * self._bar * self.view.scale, 2 * FINE))
        elif kind == "ramp":
            for k in range(FINE * _RAMP):
                colour = palette.mixed(palette.GROUND, palette.IDLE, k / (FINE * _RAMP))
                pygame.draw.line(fine, colour, (FINE * x + k, y - 4 * FINE), (FINE * x + k, y + 4 * FINE))
        elif kind == "detected":
            draw_flash(fine, np.array([[FINE * (x + 8), y]]), FINE * 3.2, 0.4)
        else:
            colour = {"seen": palette.DETECTED, "unseen": palette.UNSEEN}.get(kind, palette.TARGET)
            draw_dots(fine, np.array([[FINE * (x + 6), y]]), self._dot, kind == "fleeing", colour)


def _round_length(about: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten up to a length [m]."""
    power = 10.0 ** math.floor(math.log10(about))
    return next(factor * power for factor in (5, 2, 1) if factor * power <= about)


def decimals_of(step: float) -> int:
    """Return the number of decimals that distinguishes the times of control steps [s]."""
    return max(math.ceil(-math.log10(step) - 1e-9), 0)
