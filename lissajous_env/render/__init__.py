"""Pictures of a world: drawn on an off-screen surface with pygame; a window opens only when one is asked for."""

import os

# pygame greets on standard output when it is imported, which would end up in what commands print.
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.render.gallery import Gallery
from lissajous_env.render.renderer import Renderer

__all__ = ["Gallery", "Renderer", "Snapshot"]
