"""Untrusted files: a pickle in place of any file of any folder that a command reads is never opened."""

import shutil

import pytest

from lissajous_env.console.cli import main
from tests.storage.planted import opened, payloads, plant
from training.learned import policy

SHORT = ("--set", "task.duration=1.0")
TRAINING = (
    "--scenario", "failure", "--worlds", "2", "--rollout", "8", "--minibatch", "80", "--evaluate-every", "80",
    "--episodes", "1", "--hidden", "4", "--features", "4", "--threads", "1", *SHORT,
)  # fmt: skip


@pytest.fixture
def marker(tmp_path):
    return tmp_path / "opened"


@pytest.fixture
def attacked(tmp_path, marker, capsys):
    """Plants each pickle in each file of a folder in turn, runs a command, and tells what it ended with."""

    def attack(original, command, forms=("plain",)):
        endings = {}
        for form in forms:
            data = payloads(marker)[form]
            for path in sorted(path for path in original.rglob("*") if path.is_file()):
                name = path.relative_to(original)
                copy = tmp_path / "copy"
                shutil.copytree(original, copy)
                plant(copy / name, data)
                endings[str(name), form] = exit_code(command(copy), capsys)
                assert not opened(marker), f"{name} was unpickled"
                shutil.rmtree(copy)
        return endings

    return attack


def exit_code(arguments, capsys):
    """Exit code of a command: 2 for bad input, with why in one line; 1 where a table says that a policy failed."""
    with pytest.raises(SystemExit) as raised:
        main([str(argument) for argument in arguments])
    said = capsys.readouterr().err
    assert raised.value.code in (0, 1, 2)
    assert "Traceback" not in said
    assert raised.value.code != 2 or said.strip().rpartition("\n")[2].startswith("error: ")
    return raised.value.code


def test_a_folder_of_a_training(attacked, tmp_path, marker, capsys):
    pytest.importorskip("stable_baselines3")
    run = tmp_path / "run"
    assert exit_code(["train", *TRAINING, "--steps", "80", "--out", run], capsys) == 0

    def go_on(folder):
        return ["train", *TRAINING, "--steps", "160", "--out", folder]

    endings = attacked(run, go_on, ("plain", "archive", "npy"))
    assert exit_code(go_on(run), capsys) == 0
    assert not opened(marker)
    # The best is written anew.
    assert {name for (name, _), code in endings.items() if code} == {".lissajous.jsonl", "checkpoint.safetensors"}


@pytest.mark.parametrize("command", ["run", "benchmark"])
def test_a_folder_of_a_policy(attacked, tmp_path, command):
    shipped = policy.find("learned-watch")

    def play(folder):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        named = {
            "run": ("watch", folder, "--out", tmp_path / "out.npz"),
            "benchmark": ("--scenarios", "watch", "--policies", folder, "--episodes", "1", "--out", tmp_path / "out"),
        }
        return [command, *named[command], *SHORT]

    endings = attacked(shipped, play, ("plain", "archive") if command == "run" else ("archive",))
    assert set(endings.values()) <= {1, 2}


def test_a_folder_of_a_benchmark(attacked, tmp_path, capsys):
    original = tmp_path / "made"

    def play(folder):
        played = "--scenarios", "failure", "--policies", "still", "--episodes", "1"
        return ["benchmark", *played, "--out", folder, *SHORT]

    assert exit_code(play(original), capsys) == 0
    endings = attacked(original, play)
    assert endings["settings.json", "plain"] == 2
    assert endings["episodes.csv", "plain"] == 0


def test_a_recording(attacked, tmp_path, capsys):
    original = tmp_path / "made"
    original.mkdir()
    assert exit_code(["run", "failure", "still", "--out", original / "one.npz", *SHORT], capsys) == 0
    forms = ("plain", "archive", "npy", "npz")
    replay = lambda folder: ["replay", folder / "one.npz", "--out", tmp_path / "out.html"]  # noqa: E731
    assert set(attacked(original, replay, forms).values()) == {2}
