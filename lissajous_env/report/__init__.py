"""Report pages: one HTML file with scores and replays of many episodes, in a frame, which works offline."""

from collections.abc import Mapping
from typing import Any

from lissajous_env.replay.bundle import as_json, bundled
from lissajous_env.replay.contents import FORMAT

_EPISODES = "the episodes"
"""Placeholder of the episodes in the page of the frame."""


def report(data: Mapping[str, Any], words: Mapping[str, str], replays: Mapping[str, Mapping]) -> str:
    """Return the page of a report.

    Args:
        data: Data of the page.
        words: Texts by the slot of the template.
        replays: Playable episodes by id, from `lissajous_env.replay.contents.contents`.

    Returns:
        HTML that needs no other file and no network.
    """
    viewer = _viewer() if replays else ""
    framed = {"viewer-page": viewer.replace(as_json(_EPISODES), "@episodes@", 1)} if viewer else {}
    return bundled(
        "report.html",
        "report.js",
        data,
        words,
        styles=("style.css", "report.css"),
        blocks=framed | dict(replays),
        framed=viewer,
    )


def _viewer() -> str:
    """Return the replay page without episodes."""
    data = {"format": FORMAT, "at": "@at@", "episodes": [_EPISODES]}
    return bundled("page.html", "main.js", data, {"title": "Replay"})
