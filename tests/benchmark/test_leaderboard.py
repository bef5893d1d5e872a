"""The leaderboard: scores of references and of trainings, and entries that it refuses."""

import leaderboard
import pytest

ENTRY = {"name": "An entry", "by": "us", "command": "train", "machine": "here"}


@pytest.fixture
def small(monkeypatch):
    """One episode of each of two scenarios."""
    monkeypatch.setattr(leaderboard, "SCENARIOS", 2)
    monkeypatch.setattr(leaderboard, "EPISODES", 1)


def test_references_have_the_scores_0_and_1_and_a_training_twice_counts_as_once(small, tmp_path):
    rules = {task: [names[1]] for task, names in leaderboard.REFERENCES.items()}
    patrols = {task: [names[0]] * 2 for task, names in leaderboard.REFERENCES.items()}
    mixed = {task: [names[1], names[0]] for task, names in leaderboard.REFERENCES.items()}
    best, patrol, both = (
        leaderboard.scored(ENTRY | {"policies": policies}, tmp_path) for policies in (rules, patrols, mixed)
    )
    assert best[1:5] == ["1.00 (1.00 to 1.00)", "1.00", "1.00", "1.00"]
    assert patrol[1:5] == ["0.00 (0.00 to 0.00)", "0.00", "0.00", "0.00"]
    assert both[1:5] == ["0.50 (0.00 to 1.00)", "0.50", "0.50", "0.50"]
    assert [row[6] for row in (best, patrol, both)] == ["1", "2", "2"]


RULES = "[policies]\nwatch-v1 = ['lanes']\nintercept-v1 = {}\nhotspots-v1 = ['lanes']"


@pytest.mark.parametrize(("text", "words"), [
    ("nam = 1", "must have the keys name, by, command, machine, policies, got nam; did you mean name"),
    ("", "must have the keys name, by, command, machine, policies, policies is missing"),
    ("[policies]\nwatch-v2 = ['lanes']", "tasks|watch-v1, intercept-v1, hotspots-v1, got watch-v2; did you mean"),
    ("[policies", "mine.toml must be a TOML file that can be read: "),
    (RULES.format("'lanes'"), "intercept-v1 of mine.toml must be a list of policies, one for each training, got"),
    (RULES.format("['lanes', 'lanes']"), "must have as many trainings for each task, got {'watch-v1': 1, 'int"),
    (RULES.format("['laness']"), "policy must be .* got 'laness'; did you mean lanes"),
    (RULES.format("['nowhere:rule']"), "policy must be module:factory that can be loaded, got 'nowhere:rule'"),
])  # fmt: skip
def test_an_entry_names_what_is_wrong(tmp_path, text, words):
    path = tmp_path / "mine.toml"
    path.write_text("".join(f'{key} = "x"\n' for key in ENTRY) + text)
    with pytest.raises(ValueError, match=words):
        leaderboard.read(path)


def test_the_included_entries_can_be_read_and_an_unknown_one_is_refused_with_their_names():
    entries = [leaderboard.read(path) for path in leaderboard.FOLDER.glob("*.toml")]
    assert len(entries) >= 3
    with pytest.raises(ValueError, match=r"such as .*patrol, rules, got rule; did you mean rules\?"):
        leaderboard.read(leaderboard.FOLDER / "rule.toml")


def refusing(observation):
    raise RuntimeError("no map")


def test_a_policy_that_fails_is_named_with_its_error(small, tmp_path):
    words = r"test_leaderboard:refusing must play every scenario of watch-v1, but on watch-v1-24: RuntimeError: no map"
    with pytest.raises(ValueError, match=words):
        leaderboard.play("watch-v1", "test_leaderboard:refusing", tmp_path)
