"""Replays: an episode, or two of one seed side by side, as one HTML file that a browser plays without a network."""

from lissajous_env.replay.document import Replay, page

__all__ = ["Replay", "page"]
