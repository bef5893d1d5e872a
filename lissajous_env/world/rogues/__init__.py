"""Rogues: targets that an adversary moves, by actions or by a script; importing this registers the included scripts."""

from lissajous_env.world.rogues import scripted

__all__ = ["scripted"]
