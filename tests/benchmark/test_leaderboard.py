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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "a"', "mine.toml must have the keys by, command, machine, name, policies, got name"),
        ("[policies]\nwatch-v1 = ['lanes']", "must have the tasks watch-v1, intercept-v1, hotspots-v1, got"),
        (
            "[policies]\nwatch-v1 = ['lanes']\nintercept-v1 = ['lanes', 'lanes']\nhotspots-v1 = ['lanes']",
            "must have as many trainings for each task, got",
        ),
    ],
)
def test_an_entry_names_what_is_wrong(tmp_path, text, words):
    path = tmp_path / "mine.toml"
    head = "".join(f'{key} = "x"\n' for key in ENTRY) if "policies" in text else ""
    path.write_text(head + text)
    with pytest.raises(ValueError, match=words):
        leaderboard.read(path)


def test_the_included_entries_can_be_read():
    entries = [leaderboard.read(path) for path in leaderboard.FOLDER.glob("*.toml")]
    assert len(entries) >= 3
