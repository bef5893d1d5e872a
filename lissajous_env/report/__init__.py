"""Report pages: one HTML file with scores and replays of many episodes, which works offline."""

from lissajous_env.report.document import report

__all__ = ["report"]
