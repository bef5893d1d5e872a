"""Replay pages: an episode, or two side by side, as one HTML file that a browser plays offline."""

from lissajous_env.replay.document import Replay, page

__all__ = ["Replay", "page"]
