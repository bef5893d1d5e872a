"""Robot models: a file for each; importing this package registers the shipped ones."""

from lissajous_env.world.robots import car, point

__all__ = ["car", "point"]
