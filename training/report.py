"""Report page of a running training: learning curves, evaluations, and a replay of the latest checkpoint."""

import dataclasses
import time
from collections.abc import Mapping
from typing import Any

import baselines
from lissajous_env.episodes.recording import record
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.replay.contents import BRIEF, contents
from lissajous_env.report import report
from lissajous_env.storage.folder import Folder
from training.learned.history import LEARNING, RELATIVE, SCORES, History
from training.settings import TrainingSettings

NAME = "report.html"
FORMAT = "lissajous training 1"
SHARE = 0.01
"""Fraction of the training time that recording replays may take; if it is exceeded, evaluations skip the replay."""
_LEARNING = {
    "approx_kl": ("divergence (KL) [1/1000]", "between the policies before and after an update", 1000),
    "entropy_loss": ("entropy [nat]", "of the exploration noise", -1),
    "explained_variance": ("explained variance", "of the returns by the critic; at most 1", 1),
}
assert _LEARNING.keys() == set(LEARNING)


class TrainingReport:
    """Writer of the report of a training.

    Args:
        folder: Locked folder of the training.
        settings: Settings of the training.
        scenario: Scenario of the evaluations.
        seed: Seed of the replayed episode.
    """

    def __init__(self, folder: Folder, settings: TrainingSettings, scenario: Scenario, seed: int):
        self._folder, self._settings, self._scenario, self._seed = folder, settings, scenario, seed
        self._replays: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {}
        self._due = 0.0

    def write(self, history: History, policy: Any, last: bool) -> None:
        """Replace the page.

        Args:
            history: History of the training.
            policy: Current policy, for one world.
            last: True at the end of the training, when the replay is always recorded.
        """
        began = time.monotonic()
        if last or began >= self._due:
            self._replay(history, policy)
            self._due = time.monotonic() + (time.monotonic() - began) / SHARE
        self._folder.write(NAME, self.html(history))

    def html(self, history: History) -> str:
        """Return the page."""
        settings = self._settings
        scores = [{"name": name, "title": of.heading, "about": of.described} for name, of in SCORES.items()]
        several = settings.space is not None
        if several:
            scores[0] |= {"title": "detection, geometric mean", "about": "geometric mean over the scenarios"}
            rival = next(iter(history.rivals), "the policy itself")
            about = f"detection time relative to that of {rival} in the same scenario, geometric mean over scenarios"
            scores.insert(0, {"name": RELATIVE, "title": "relative time", "about": about})
        data = {
            "format": FORMAT,
            "scores": scores,
            "scenarios": _by_scenario(history) if several else [],
            "curve": history.curve,
            "learned": [
                {"name": name, "title": title, "about": about, "times": times}
                for name, (title, about, times) in _LEARNING.items()
            ],
            "learning": history.learning,
            "lost": {rival: worse for rival in history.rivals if (worse := history.losses(rival))},
            "rivals": [
                {"name": name, **{score["name"]: of[score["name"]] for score in scores}}
                for name, of in history.rivals.items()
            ],
            "best": history.best["steps"] if history.best else None,
            "settings": _sorted_settings(settings),
            "replays": {name: entry for name, (entry, _) in self._replays.items()},
        }
        done = f"{history.steps:,} of {settings.steps:,} robot steps, {history.seconds / 60:.1f} min"
        words = {"title": f"{settings.scenario}, seed {settings.seed}", "state": done}
        return report(
            "training.html", "training.js", data, words, {name: of for name, (_, of) in self._replays.items()}
        )

    def _replay(self, history: History, policy: Any) -> None:
        """Record the episode with the current policy, and once with the first rival."""
        played = {"replay-policy": self._played(policy, f"{history.steps:,} steps")}
        if "replay-rival" in self._replays:
            played["replay-rival"] = self._replays["replay-rival"]
        elif self._settings.chosen_rivals:
            rival = self._settings.chosen_rivals[0]
            made = baselines.make(rival, self._scenario, 1, self._settings.device)
            played["replay-rival"] = self._played(made, rival)
        self._replays = played

    def _played(self, policy: Any, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
        recording = record(policy, self._scenario, self._seed, self._settings.device)
        of = contents(recording, BRIEF) | {"policy": name}
        entry = {
            "title": f"{self._scenario.name} · {name} · seed {self._seed}",
            "group": "",
            "policy": name,
            "note": "",
        }
        return entry, of


def _by_scenario(history: History) -> list[dict[str, Any]]:
    """Return for each scenario its name, and detection time and collisions of the latest policy and of the rivals."""
    played = {name: of["scenarios"] for name, of in history.rivals.items()}
    if history.curve:
        played = {"policy": history.curve[-1]["scenarios"]} | played
    names = dict.fromkeys(made for each in played.values() for made in each)
    return [
        {"name": made, "policies": {name: each[made] for name, each in played.items() if made in each}}
        for made in names
    ]


def _sorted_settings(settings: TrainingSettings) -> dict[str, list[tuple[str, str]]]:
    """Return the settings that differ from their defaults, the scenario among them, and the others, in words.

    A default that depends on other settings is shown as what it resolves to, or else as `default`.
    """
    values = settings.to_dict()
    changed, others = [], []
    for field in dataclasses.fields(settings):
        if field.name == "overrides":
            changed += [(name, _in_words(value)) for name, value in settings.overrides.items()]
        elif field.name not in values:
            continue
        elif field.name == "scenario" or getattr(settings, field.name) != field.default:
            changed.append((field.name, _in_words(values[field.name])))
        else:
            unset = values[field.name] is None or values[field.name] == []
            others.append((field.name, "default" if unset else _in_words(values[field.name])))
    return {"changed": changed, "others": others}


def _in_words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} = {each}" for name, each in value.items()) or "none"
    if isinstance(value, (list, tuple)):
        return ", ".join(map(str, value)) or "none"
    return "none" if value is None else f"{value:,}" if type(value) is int else str(value)
