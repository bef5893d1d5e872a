"""What stands around the plot: the status line above it, scale bar and legend below."""

import math
from functools import lru_cache

import numpy as np
import pygame

from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE, FOOTER, HEADER, MARGIN, Colour, View, stamp
from lissajous_env.render.snapshot import Snapshot
from lissajous_env.scenario import Scenario


@lru_cache(maxsize=16)
def _font(height: int) -> pygame.font.Font:
    pygame.font.init()
    return pygame.font.Font(None, height) 
