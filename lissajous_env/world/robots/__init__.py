"""Robot models: a file for each; importing this package registers the included ones."""

from lissajous_env.world.robots import car, differential, point

__all__ = ["car", "differential", "point"]
