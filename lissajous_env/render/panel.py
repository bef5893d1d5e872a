"""The surroundings of the plot: the status line above, scale bar and legend below."""

import math

import numpy as np
import pygame

from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE, FOOTER, HEADER, MARGIN, View
from lissajous_env.render.targets import draw_dots, draw_flash
from lissajous_env.render.text import width_of, write
from lissajous_env.render.times import decimals_of

_GAP = 22
"""Space between entries [px]."""
_RAMP = 64
"""Width of the colour scale [px]."""


class Panel:
    """Draws the surroundings of one scenario's plot; entries that do not fit are omitted."""

    def __init__(self, scenario: Scenario, view: View, idle_full: float, dot: float):
        self.scenario, self.view, self.idle_full = scenario, view, idle_full
        plot, wide = view.rectangle(fine=False), view.size[0] >= 560
        # The lines have at least the width of the plot.
        spare = max(620 - plot.width, 0) // 2
        self.left = max(plot.left - spare, MARGIN)
        self.right = min(plot.right + spare, view.size[0] - MARGIN)
        self.large, self.medium, self.small = (19, 15, 13) if wide else (14, 12, 10)
        self._dot = FINE * min(max(dot, 2.4), 3.6)
        self._status_at = (self.left, HEADER // 2 - 3)
        self._legend_at = view.size[1] - FOOTER // 2 - 2
        self._bar = _round_length(0.16 * (self.right - self.left) / view.scale)

    def draw_fixed(self, fine: pygame.Surface) -> None:
        """Draw the constant parts: the scenario's name and the legend."""
        write(fine, self.scenario.name, self._status_at, self.large, palette.INK)
        y, x = self._legend_at, float(self.left)
        for kind, indent, words in self._legend():
            if x + indent + width_of(words, self.small) > self.right:
                return
            self._draw_sign(fine, kind, x)
            x = write(fine, words, (x + indent, y), self.small, palette.MUTED) + _GAP
        words = f"not sensed for {float(f'{self.idle_full:.2g}'):g} s or more"
        start = self.right - width_of(words, self.small)
        if self.scenario.task.grid is not None and start - _RAMP - 8 >= x:
            self._draw_ramp(fine, start - _RAMP - 8)
            write(fine, words, (start, y), self.small, palette.MUTED)

    def draw(self, fine: pygame.Surface, snapshot: Snapshot) -> None:
        """Draw the current numbers and the progress of the episode."""
        line = pygame.Rect(FINE * self.left, FINE * (HEADER - 6), FINE * (self.right - self.left), 2 * FINE)
        pygame.draw.rect(fine, palette.HAIRLINE, line)
        line.width = round(line.width * min(snapshot.step / self.scenario.task.steps, 1.0))
        pygame.draw.rect(fine, palette.ROBOT, line)
        entries = self._status(snapshot)
        room = self.right - self.left - width_of(self.scenario.name, self.large)
        # The least important entries are omitted first.
        for _, least in sorted((rank, k) for k, (rank, *_) in enumerate(entries)):
            wide = sum(_GAP + sum(width_of(word, self.medium) for word in words) for _, *words in entries if words)
            if wide > room:
                entries[least] = (0,)
        x = self.right + _GAP
        for _, *words in reversed(entries):
            if words:
                x -= _GAP + sum(width_of(word, self.medium) for word in words)
                self._write_entry(fine, x, words, snapshot)

    def _write_entry(self, fine: pygame.Surface, x: float, words: list[str], snapshot: Snapshot) -> None:
        alarm = words[0].startswith("collisions") and snapshot.collisions > 0
        value = palette.CONTACT if alarm else palette.INK
        for word, colour in zip(words, (palette.MUTED, value, palette.MUTED), strict=True):
            if word:
                x = write(fine, word, (x, self._status_at[1]), self.medium, colour)

    def _status(self, snapshot: Snapshot) -> list[tuple]:
        """Return the entries of the status line: rank, prefix, value and suffix."""
        task = self.scenario.task
        decimals = decimals_of(task.step)
        entries: list[tuple] = [(4, "", f"{snapshot.step * task.step:.{decimals}f} s", f" of {task.duration:g} s")]
        if self.scenario.target_capacity > 0:
            mean = snapshot.mean_detection_time(task.step)
            appeared = int(np.count_nonzero(snapshot.appears_at <= snapshot.step))
            entries += [
                (3, "detected ", f"{np.count_nonzero(snapshot.found):,}", f" of {appeared:,}"),
                (1, "mean detection time ", "none" if math.isnan(mean) else f"{mean:.{decimals + 1}f} s", ""),
            ]
        return [*entries, (2, "collisions ", f"{snapshot.collisions}", "")]

    def _legend(self) -> list[tuple[str, float, str]]:
        """Return the entries of the legend: sign, width [px] and text."""
        targets = self.scenario.targets
        entries = [("bar", self._bar * self.view.scale + 8, f"{self._bar:g} m")]
        if self.scenario.target_capacity > 0:
            entries.append(("target", 15.0, "target"))
            if targets.fleeing > 0:
                entries.append(("fleeing", 15.0, "fleeing target"))
            entries.append(("detected", 20.0, "detected"))
        return entries

    def _draw_sign(self, fine: pygame.Surface, kind: str, x: float) -> None:
        y = FINE * self._legend_at
        if kind == "bar":
            ends = FINE * x, FINE * (x + self._bar * self.view.scale)
            pygame.draw.line(fine, palette.INK, (ends[0], y), (ends[1], y), round(1.5 * FINE))
            for end in ends:
                pygame.draw.line(fine, palette.INK, (end, y - 4 * FINE), (end, y + 4 * FINE), round(1.5 * FINE))
        elif kind == "detected":
            draw_flash(fine, np.array([[FINE * (x + 8), y]]), FINE * 3.2, 0.4)
        else:
            draw_dots(fine, np.array([[FINE * (x + 6), y]]), self._dot, flees=kind == "fleeing")

    def _draw_ramp(self, fine: pygame.Surface, x: float) -> None:
        box = pygame.Rect(round(FINE * x), FINE * (self._legend_at - 4), FINE * _RAMP, FINE * 8)
        for k in range(box.width):
            colour = palette.mixed(palette.GROUND, palette.IDLE, k / box.width)
            pygame.draw.line(fine, colour, (box.left + k, box.top), (box.left + k, box.bottom - 1))
        pygame.draw.rect(fine, palette.EDGE, box, FINE)


def _round_length(about: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten up to a length [m]."""
    power = 10.0 ** math.floor(math.log10(about))
    return next(factor * power for factor in (5, 2, 1) if factor * power <= about)
