"""`lissajous train --league`: both sides learn in turn, each against a mixture of all agents of the other side so far.

In each round rogues are trained against the mixture of teams, then a team against the mixture of rogues. The mixtures
are those of the equilibrium of the game between all agents so far, as in the method PSRO of M. Lanctot et al., "A
Unified Game-Theoretic Approach to Multiagent Reinforcement Learning" (NeurIPS 2017). Training against the latest
opponent alone can go in circles. Agents are not trained further after their round.
"""

import dataclasses
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from baselines.exploitability.bracket import CrossPlay, Estimate, Exploit, cross_play, rogue_names
from baselines.exploitability.page import cross_play_page
from baselines.exploitability.tables import as_plain, print_game, short_name
from baselines.policies.factories import named
from lissajous_env.console.terminal import make_console
from lissajous_env.parameters.rogues import AND
from lissajous_env.storage.files import read_json
from lissajous_env.storage.folder import Folder
from training.rogue_settings import SHARED, RogueTraining
from training.sb3.rogue_trainer import train_rogues
from training.sb3.trainer import train
from training.settings import TrainingSettings

STATE, PAGE = "league.json", "league.html"
"""Files in the folder of a league: results so far, and the page of the game."""
FIRST_ROGUES = "wander", "flee", "follow-gap"
"""Rogues before the first round."""
SHARES = 8
"""Number of equal shares to which the probabilities of a mixture are rounded."""
EPISODES = 16
"""Number of episodes of each team against each rogue."""
_FIRST_SEED = 30_000
_MEASURE = "mean"
_MOST_ROUNDS = 1000
_CHANGES_NOTHING = "threads", "evaluation_episodes", "rivals"
"""Settings that may change when a league is resumed."""


def shares_of(names: Sequence[str], probabilities: np.ndarray) -> str:
    """Return the name of a mixture whose shares are the nearest ones to some probabilities.

    Shares are rounded down, and those that are left go to the largest remainders.
    """
    exact = np.asarray(probabilities) * SHARES
    counts = np.floor(exact + 1e-9).astype(int)
    remainders = np.argsort(counts - exact, kind="stable")
    counts[remainders[: SHARES - counts.sum()]] += 1
    divisor = int(np.gcd.reduce(counts))
    return AND.join(name for name, count in zip(names, counts // divisor, strict=True) for _ in range(count))


@dataclasses.dataclass(frozen=True)
class LeagueSettings:
    """Settings of a league."""

    rounds: int
    """Number of rounds."""
    teams: TrainingSettings
    """Settings of the training of a team in a round; `out` is the folder of the league."""
    against: tuple[str, ...]
    """Policies of the robots before the first round."""
    rogues: tuple[str, ...] = FIRST_ROGUES
    """Rogues before the first round."""
    of_rogues: dict[str, Any] = dataclasses.field(default_factory=dict)
    """Fields of `RogueTraining` that differ from their defaults."""

    def __post_init__(self) -> None:
        if not 1 <= self.rounds <= _MOST_ROUNDS:
            raise ValueError(f"league must be from 1 to {_MOST_ROUNDS:,} rounds, got {self.rounds!r}")
        if not self.against or len(set(self.against)) < len(self.against):
            raise ValueError(f"against must be policies, each once, got {', '.join(self.against) or 'none'}")
        if self.teams.engine != "sb3":
            raise ValueError(f"engine must be sb3 in a league, got {self.teams.engine}")
        rogue_names(self.teams.make_home_scenario(), self.rogues)
        self.rogue_training(AND.join(self.against), 1)

    def folder_of(self, side: str, k: int) -> Path:
        """Return the folder of an agent of a round: `team-1`, `rogues-1` and so on."""
        return self.teams.out / f"{side}-{k}"

    def rogue_training(self, against: str, k: int) -> RogueTraining:
        """Return the settings of the training of rogues in a round."""
        shared = {name: getattr(self.teams, name) for name in (*SHARED, "overrides")}
        own = {"out": self.folder_of("rogues", k), "seed": (self.teams.seed + k - 1) % 2048, "against": against}
        return RogueTraining(**shared | own | self.of_rogues)

    def team_training(self, rogues: str, k: int) -> TrainingSettings:
        """Return the settings of the training of a team in a round, from the second on from the team before."""
        changed: dict[str, Any] = {"out": self.folder_of("team", k), "seed": (self.teams.seed + k - 1) % 2048}
        changed["overrides"] = {**self.teams.overrides, "targets.rogues": rogues}
        if k > 1:
            changed |= {"start": str(self.folder_of("team", k - 1) / "best"), "teacher": "none"}
        return dataclasses.replace(self.teams, **changed)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values of what must be the same when a league is resumed."""
        teams, of_rogues = self.teams.to_dict(), self.rogue_training(AND.join(self.against), 1).to_dict()
        for name in _CHANGES_NOTHING:
            teams.pop(name, None)
            of_rogues.pop(name, None)
        plain = {"against": self.against, "rogues": self.rogues, "teams": teams, "of_rogues": of_rogues}
        return json.loads(json.dumps(plain))  # tuples become lists, as in the file


def train_league(settings: LeagueSettings, console: Console | None = None) -> dict[str, Any]:
    """Train both sides in turn, from the last finished training if `settings.teams.out` has any; return the game.

    Raises:
        ValueError: the folder contains other files or a league with other settings, or is in use by another process.
        KeyboardInterrupt: Ctrl-C; the same settings resume the league.
    """
    with Folder(settings.teams.out, (STATE, PAGE)) as folder:
        return League(settings, console or make_console(), folder).run()


class League:
    """A league in a locked folder."""

    def __init__(self, settings: LeagueSettings, console: Console, folder: Folder):
        self.settings, self.console, self.folder = settings, console, folder
        self.scenario = settings.teams.make_home_scenario()
        self.starts = settings.rogue_training(AND.join(settings.against), 1).starts
        self.teams = {name: name for name in settings.against}
        """Folder or policy of each team, by name."""
        self.rogues = list(settings.rogues)
        self.exploits: dict[tuple[str, str], Exploit] = {}
        """Results by team and rogue."""
        self.bounds: dict[str, Estimate] = {}
        if (settings.teams.out / STATE).exists():
            self._resume()

    def run(self) -> dict[str, Any]:
        """Train until the last round, play all against all, and write the page."""
        self._play()
        for k in range(1, self.settings.rounds + 1):
            self._train_rogues(k)
            self._train_team(k)
        found = self.game()
        print_game(self.console, found, _MEASURE)
        self.folder.write(PAGE, cross_play_page(found, _MEASURE))
        self._say(f"wrote {self.settings.teams.out / PAGE}")
        return as_plain(found, _MEASURE)

    def game(self) -> CrossPlay:
        """Return the game of all agents so far."""
        teams, rogues = tuple(self.teams), tuple(self.rogues)
        exploits = tuple(self.exploits[team, rogue] for team in teams for rogue in rogues)
        return CrossPlay(self.scenario.name, teams, rogues, exploits, {name: self.bounds[name] for name in self.bounds})

    def _train_rogues(self, k: int) -> None:
        folder = str(self.settings.folder_of("rogues", k))
        if not self._has_played(self.teams, [folder]):
            mixture = shares_of([*self.teams.values()], self.game().game(_MEASURE).teams)
            names = {folder: name for name, folder in self.teams.items()}
            self._say(f"round {k} of {self.settings.rounds}: rogues against {_in_words(mixture, names.__getitem__)}")
            train_rogues(self.settings.rogue_training(mixture, k), self.console)
        self.rogues.append(folder)
        self._play()

    def _train_team(self, k: int) -> None:
        folder = self.settings.folder_of("team", k)
        if not self._has_played([folder.name], self.rogues):
            mixture = shares_of(self.rogues, self.game().game(_MEASURE).rogues)
            self._say(f"round {k} of {self.settings.rounds}: team against {_in_words(mixture, short_name)}")
            train(self.settings.team_training(mixture, k), self.console)
        self.teams[folder.name] = str(folder / "best")
        self._play()

    def _has_played(self, teams: Any, rogues: Sequence[str]) -> bool:
        return all((team, rogue) in self.exploits for team in teams for rogue in rogues)

    def _play(self) -> None:
        """Play the teams against the rogues against which they have not played, and store the results."""
        seeds = range(_FIRST_SEED, _FIRST_SEED + EPISODES)
        for team, policy in self.teams.items():
            new = [rogue for rogue in self.rogues if (team, rogue) not in self.exploits]
            if not new:
                continue
            members = [(team, named(policy))]
            found = cross_play(self.scenario, members, new, seeds, self.starts, self.settings.teams.device)
            self.exploits |= {(team, each.rogue): each for each in found.exploits}
            self.bounds = {**found.bounds, **self.bounds}
            self._save()
            for each in found.exploits:
                self._say(f"{team} against {short_name(each.rogue)}: undetected for {each.mean} s")

    def _save(self) -> None:
        text = {
            "format": 1,
            "settings": self.settings.to_dict(),
            "exploits": [dataclasses.asdict(each) for each in self.exploits.values()],
            "bounds": {name: dataclasses.asdict(each) for name, each in self.bounds.items()},
        }
        self.folder.write(STATE, json.dumps(text, indent=1))

    def _resume(self) -> None:
        path = self.settings.teams.out / STATE
        text, ours = read_json(path), self.settings.to_dict()
        try:
            theirs = text["settings"]
            for each in text["exploits"]:
                estimates = {name: Estimate(**each[name]) for name in ("mean", "longest")}
                made = Exploit(each["policy"], each["rogue"], quantile=each["quantile"], **estimates)
                self.exploits[made.policy, made.rogue] = made
            self.bounds = {name: Estimate(**each) for name, each in text["bounds"].items()}
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"{path} is damaged: {type(error).__name__}: {error}") from error
        if theirs != ours:
            parts = [name for name in ours if theirs.get(name) != ours[name]]
            rule = "must be an empty folder or contain a league with the same settings"
            raise ValueError(f"out {rule}, got {self.settings.teams.out}, whose {' and '.join(parts)} differ")

    def _say(self, text: str) -> None:
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)


def _in_words(mixture: str, name_of: Callable[[str], str]) -> str:
    """Return the members of a mixture with their shares."""
    members = mixture.split(AND)
    if len(set(members)) == 1:
        return name_of(members[0])
    return ", ".join(f"{members.count(each)}/{len(members)} {name_of(each)}" for each in dict.fromkeys(members))
