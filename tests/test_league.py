"""Both sides learn in turn: teams against rogues of any kind, mixtures of all agents so far, resumed after a kill."""

import json

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from rich.console import Console

import lissajous_env
from baselines.exploitability.survival import survive, with_starts
from lissajous_env.parameters.rogues import rogue_of
from tests.command_line import called
from training.learned import checkpoint
from training.rogue_settings import RogueTraining
from training.sb3 import league as leagues
from training.sb3 import rogue_trainer
from training.sb3.league import LeagueSettings, shares_of, train_league
from training.sb3.rogue_trainer import train_rogues
from training.settings import TrainingSettings

SMALL = {"sensing.radius": 0.35, "task.duration": 5.0, "targets.entry": "unseen"}
FAST = {"scenario": "experiment", "steps": 800, "worlds": 4, "rollout": 20, "base": "none", "teacher": "none",
        "rivals": (), "layers": (8,), "evaluate_every": 800, "evaluation_episodes": 4, "threads": 1,
        "overrides": SMALL}  # fmt: skip


def settings_of(out, rounds=2, **teams):
    of_rogues = {"rounds": 2, "steps": 0, "starts": 16, "worlds": 4}
    teams = TrainingSettings(**FAST | teams, out=out)
    return LeagueSettings(rounds, teams, ("sweep", "still"), ("flee",), of_rogues)


@pytest.fixture(scope="module", autouse=True)
def small():
    """Play few episodes, and imitate with few batches."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(leagues, "EPISODES", 3)
        patch.setattr(rogue_trainer, "_LAST_BATCHES", 50)
        patch.setattr(rogue_trainer, "_BATCHES", 50)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory, small):
    """Folder and game of a league of two rounds."""
    out = tmp_path_factory.mktemp("league") / "run"
    return out, train_league(settings_of(out), Console(quiet=True))


def test_a_league_ends_with_the_game_of_all_agents(finished):
    # Oracle: the same teams and rogues, played by `exploit`.
    out, found = finished
    assert found["policies"] == ["sweep", "still", "team-1", "team-2"]
    assert found["rogues"] == ["flee", str(out / "rogues-1"), str(out / "rogues-2")]
    scenario = with_starts(lissajous_env.scenario("experiment", **SMALL), str(out / "rogues-2"), 16)
    times = survive(str(out / "team-1" / "best"), scenario, range(30_000, 30_003)).means
    (told,) = [
        each for each in found["exploits"] if (each["policy"], each["rogue"]) == ("team-1", scenario.targets.rogues)
    ]
    assert told["mean"]["value"] == pytest.approx(times.mean())
    assert "team-2" in (out / "league.html").read_text(encoding="utf-8")
    assert found["game"]["value"] == pytest.approx(max(found["game"]["against_policies"].values()))


def test_agents_of_a_league_are_ordinary_checkpoints(finished):
    # Story: a rogue of the league is named like a script, a team like a policy, and each tells what it learned against.
    out, _ = finished
    policy = lissajous_env.policy(str(out / "team-2" / "best"), lissajous_env.scenario("experiment", **SMALL), 2)
    rows = lissajous_env.evaluate(policy, "experiment", range(2), rogues=str(out / "rogues-2"), **SMALL)
    assert len(rows) == 2
    text = checkpoint.read_text(out / "rogues-2")
    assert set(text["settings"]["against"].split("+")) <= {"sweep", "still", str(out / "team-1" / "best")}
    text = checkpoint.read_text(out / "team-2")
    assert set(text["settings"]["overrides"]["targets.rogues"].split("+")) <= {
        "flee",
        *(str(out / f"rogues-{k}") for k in (1, 2)),
    }
    assert text["settings"]["start"] == str(out / "team-1" / "best")


def test_a_killed_league_goes_on_where_it_stopped(finished, tmp_path, monkeypatch):
    # Oracle: the game of a league that was not killed. It is killed after the rogues of round 2 have been trained.
    out, found = finished
    trained, train_rogues, train = [], leagues.train_rogues, leagues.train

    class KilledError(Exception):
        pass

    def rogues_then_killed(settings, console):
        trained.append(settings.out.name)
        train_rogues(settings, console)
        if settings.out.name == "rogues-2":
            raise KilledError

    def team(settings, console):
        trained.append(settings.out.name)
        return train(settings, console)

    monkeypatch.setattr(leagues, "train_rogues", rogues_then_killed)
    monkeypatch.setattr(leagues, "train", team)
    with pytest.raises(KilledError):
        train_league(settings_of(tmp_path / "run"), Console(quiet=True))
    assert trained == ["rogues-1", "team-1", "rogues-2"]
    before = (tmp_path / "run" / "rogues-2" / checkpoint.FILE).read_bytes()
    monkeypatch.setattr(leagues, "train_rogues", train_rogues)
    again = train_league(settings_of(tmp_path / "run"), Console(quiet=True))
    assert trained[3:] == ["team-2"]
    assert (tmp_path / "run" / "rogues-2" / checkpoint.FILE).read_bytes() == before
    assert json.dumps(again["exploits"]).replace(str(tmp_path / "run"), str(out)) == json.dumps(found["exploits"])
    monkeypatch.setattr(leagues, "train", None)  # nothing is trained again
    monkeypatch.setattr(leagues, "train_rogues", None)
    assert train_league(settings_of(tmp_path / "run"), Console(quiet=True))["exploits"] == again["exploits"]


def test_shares_are_the_nearest_to_the_probabilities():
    # Law: shares sum to all of them, differ by less than one from the exact ones, and are reduced.
    assert shares_of(["a", "b"], np.array([0.5, 0.5])) == "a+b"
    assert shares_of(["a", "b"], np.array([0.0, 1.0])) == "b"
    draw = np.random.default_rng(0)
    for _ in range(50):
        exact = draw.dirichlet(np.ones(4))
        shares = shares_of(list("abcd"), exact).split("+")
        parts = np.array([shares.count(name) for name in "abcd"]) / len(shares)
        assert 8 % len(shares) == 0
        assert np.abs(parts - exact).max() < 1 / 8


def test_a_team_is_trained_against_rogues(tmp_path, capsys):
    # Story: `--rogues` moves the targets in training and evaluations; the same command resumes, another one is refused.
    fast = ["--scenario", "experiment", "--steps", 400, "--worlds", 2, "--rollout", 20, "--base", "none", "--teacher",
            "none", "--rivals", "--layers", 8, "--evaluation-episodes", 2, "--threads", 1, "--out", tmp_path / "run",
            "--set", *[f"{name}={value}" for name, value in SMALL.items()]]  # fmt: skip
    code, _, error = called(capsys, "train", "--rogues", "flee", "wander", *fast)
    assert code == 0, error
    assert checkpoint.read(tmp_path / "run")[1].home["targets"]["rogues"] == "flee+wander"
    code, _, error = called(capsys, "train", "--rogues", "flee", *fast)
    assert code == 2
    assert "'targets.rogues': 'flee'" in error


def test_rogues_learn_against_several_policies(tmp_path):
    # Story: imitation and PPO against two policies at once; the rogue tells which.
    fast = {name: FAST[name] for name in ("scenario", "threads", "overrides")} | {"worlds": 4, "evaluation_episodes": 4}
    settings = RogueTraining(against="sweep+still", rounds=2, steps=50, starts=16, out=tmp_path / "run", **fast)
    history = train_rogues(settings, Console(quiet=True))
    assert [point["steps"] > 0 for point in history["curve"]] == [False, True]
    assert rogue_of(str(tmp_path / "run")).trained_against == ("sweep", "still")
    with pytest.raises(ValueError, match="worlds must be at least the 3 policies in against, got 2"):
        RogueTraining(against="sweep+still+sweep", **fast | {"worlds": 2})


def test_bad_input_is_refused_by_name(finished, capsys, tmp_path):
    out, _ = finished
    with pytest.raises(ValueError, match=r"league with the same settings, got .*, whose teams and of_rogues differ"):
        train_league(settings_of(out, seed=1), Console(quiet=True))
    with pytest.raises(ValueError, match="league must be from 1 to 1,000 rounds, got 0"):
        settings_of(tmp_path, rounds=0)
    for arguments, words in (
        (("--rogues", "fle"), "targets.rogues must be one of"),
        (("--rogues", "flee", "--set", "rogues=shadow"), "rogues must not be set with --set if --rogues"),
        (("--rogues", "flee", "--side", "rogues"), "side must be robots with --rogues or --league, got rogues"),
        (("--league", 1), "against must be policies, each once, got none"),
        (("--league", 1, "--against", "sweep", "sweep"), "against must be policies, each once, got sweep, sweep"),
        (("--league", 1, "--against", "swep"), "policy must be one of"),
        (("--league", 1, "--against", "sweep", "--engine", "ray"), "engine must be sb3 in a league, got ray"),
    ):
        code, _, error = called(capsys, "train", "--out", tmp_path / "run", *arguments)
        assert code == 2
        assert words in error
