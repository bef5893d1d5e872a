"""Reports: one HTML file of many episodes, their numbers and their replays, that needs no server and no network."""

from lissajous_env.report.document import report

__all__ = ["report"]
