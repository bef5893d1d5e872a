"""Commands that are killed, or run out of disk, at any write: repeating them gives the same result."""

import functools
import re
import shutil

import pytest

pytest.importorskip("stable_baselines3")

from test_files import NEIGHBOURS

from lissajous_env.storage.folder import Folder
from tests.storage import killing
from training.learned import checkpoint


@functools.cache
def whole(name, root):
    """A command in the small, what reads its result, its result where nobody kills it, and how often it writes."""
    work, read = killing.WORK[name]
    writes = killing.run(work, root / name).writes
    return work, read, read(root / name), writes


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return tmp_path_factory.mktemp("whole")


def check(whole, folder, point, full):
    work, read, wanted, _ = whole
    folder.mkdir()
    for name in NEIGHBOURS:
        (folder / name).write_text("mine")
    ended = killing.run(work, folder, point, full)
    if full:
        assert re.fullmatch(r"(OSError|ValueError): .*No space left on device.*", ended.error)
        assert str(folder) in ended.error
    else:
        assert ended.killed
    again = killing.run(work, folder)
    assert (again.killed, again.error) == (False, "")
    for name in NEIGHBOURS:
        assert (folder / name).read_text() == "mine"
        (folder / name).unlink()
    contents = read(folder)
    assert set(contents) == set(wanted)
    for name, value in wanted.items():
        assert contents[name] == value, f"{name} after point {point}"


@pytest.mark.parametrize(
    ("name", "share", "full"), [("benchmark", 0.5, False), ("benchmark", 0.8, True), ("train", 0.6, False)]
)
def test_a_write(root, tmp_path, name, share, full):
    # Oracle: the same command, never killed.
    point = round(share * (whole(name, root)[-1] - 1))
    check(whole(name, root), tmp_path / "out", point, full)


@pytest.mark.long
@pytest.mark.parametrize("full", [False, True], ids=["killed", "full"])
@pytest.mark.parametrize("name", killing.WORK)
def test_every_write(root, tmp_path, name, full):
    for point in range(whole(name, root)[-1]):
        check(whole(name, root), tmp_path / "out", point, full)
        shutil.rmtree(tmp_path / "out")


def test_a_kill_after_the_best_is_written_and_before_the_checkpoint(tmp_path, monkeypatch):
    # Oracle: the command that nobody killed. The best policy is ahead of the training that is resumed.
    monkeypatch.setattr("training.trainer.rating_of", lambda point, limit: point["steps"])
    killing.train(tmp_path / "whole")
    claim, seen = Folder._claim, []

    def killed(folder, claimed):
        seen.append(claimed)
        if claimed == checkpoint.FILE and seen.count(f"best/{checkpoint.FILE}") == 2:
            raise KeyboardInterrupt
        return claim(folder, claimed)

    with monkeypatch.context() as patch:
        patch.setattr(Folder, "_claim", killed)
        with pytest.raises(KeyboardInterrupt):
            killing.train(tmp_path / "cut")
    assert len(checkpoint.read_description(tmp_path / "cut" / "best")["training"]["curve"]) == 2
    assert len(checkpoint.read_description(tmp_path / "cut")["training"]["curve"]) == 1
    killing.train(tmp_path / "cut")
    assert killing.result_of_train(tmp_path / "cut") == killing.result_of_train(tmp_path / "whole")
