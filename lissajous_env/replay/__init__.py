"""Replay pages: an episode, or two side by side, as one HTML file that a browser plays offline, or a notebook shows."""

import html
from pathlib import Path

from lissajous_env.episodes.missed import MissedRogue
from lissajous_env.episodes.recording import Recording
from lissajous_env.replay import contents
from lissajous_env.replay.page import html_page
from lissajous_env.storage.files import replacing

FRAME_HEIGHT = 860
"""Height of the frame in a notebook [px]."""


class Replay:
    """Replay page of an episode, which notebooks display as the last value of a cell, and which can be saved.

    Args:
        recording: The episode.
        against: Another episode, for example of another policy on the same seed, shown beside it with one cursor.
        missed: A rogue that the policy of the first episode misses.
    """

    def __init__(self, recording: Recording, against: Recording | None = None, missed: MissedRogue | None = None):
        self.recording, self.against, self.missed = recording, against, missed

    def html(self) -> str:
        """Return the page as HTML that needs no other file and no network."""
        episodes = [self.recording] if self.against is None else [self.recording, self.against]
        policies = " against ".join(str(episode.score.get("policy", "")) or "an episode" for episode in episodes)
        shown = [contents.contents(self.recording, missed=self.missed), *map(contents.contents, episodes[1:])]
        title = f"{self.recording.scenario.name}: {policies}"
        data = {"format": contents.FORMAT, "episodes": shown}
        return html_page("page.html", "main.js", data, texts={"title": title})

    def save(self, path: str | Path) -> None:
        """Write the page, first under a temporary name."""
        with replacing(path) as temporary:
            temporary.write_text(self.html(), encoding="utf-8")

    def _repr_html_(self) -> str:
        """Return a frame that isolates the page from the notebook."""
        return (
            f'<iframe title="replay" sandbox="allow-scripts" width="100%" height="{FRAME_HEIGHT}" frameborder="0" '
            f'srcdoc="{html.escape(self.html(), quote=True)}"></iframe>'
        )
