"""Pictures and films of a world, drawn off-screen with pygame; windows open only on request."""

import os

# On import, pygame prints a greeting to stdout, where it would disturb the output of commands.
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.render.renderer import Renderer

__all__ = ["Renderer", "Snapshot"]
