"""The page of a report: its own template and modules, the style of the replay page, and that page itself in a frame."""

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from lissajous_env.replay.bundle import ASSETS, Folders, as_json, bundled
from lissajous_env.replay.contents import FORMAT

FOLDERS: Folders = (files("lissajous_env.report") / "assets", ASSETS)
"""Where templates, style sheets and modules of a report are."""
_EPISODES = "the episodes"
"""What stands in the page of the frame where the episodes are put."""


def report(
    template: str, entry: str, data: Mapping[str, Any], words: Mapping[str, str], replays: Mapping[str, Mapping]
) -> str:
    """Make a report.

    Args:
        template: Name of its template.
        entry: Name of the module that runs.
        data: What it shows.
        words: Texts by the slot of the template that they fill.
        replays: Episodes that can be played in it, as `lissajous_env.replay.contents.contents` makes them, by id.

    Returns:
        HTML that needs no other file and no network.
    """
    viewer = _viewer(any(each["scenario"]["half"][2] > 0 for each in replays.values())) if replays else ""
    framed = {"viewer-page": viewer.replace(as_json(_EPISODES), "@episodes@", 1)} if viewer else {}
    return bundled(
        template,
        entry,
        data,
        words,
        styles=("style.css", "report.css"),
        folders=FOLDERS,
        blocks=framed | dict(replays),
        framed=viewer,
    )


def _viewer(in_space: bool) -> str:
    """Make the page that plays episodes, without any."""
    libraries = ["uPlot", "three"] if in_space else ["uPlot"]
    data = {"format": FORMAT, "theme": "@theme@", "at": "@at@", "episodes": [_EPISODES]}
    return bundled("page.html", "main.js", data, {"title": "Replay"}, libraries)
