"""Commands that are killed, or run out of disk, at any write: repeating them gives the same result."""

import re
import shutil

import pytest

pytest.importorskip("stable_baselines3")

from test_files import NEIGHBOURS

from lissajous_env.storage.folder import Folder
from tests.storage import killing
from training.learned import checkpoint


@pytest.fixture(scope="module", params=killing.WORK)
def whole(request, tmp_path_factory):
    """A command in the small, what reads its result, its result where nobody kills it, and how often it writes."""
    work, read = killing.WORK[request.param]
    folders = {full: tmp_path_factory.mktemp(f"{request.param}-{full}") for full in (False, True)}
    writes = {full: killing.run(work, folder, full=full).writes for full, folder in folders.items()}
    return work, read, read(folders[False]), writes


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
    found = read(folder)
    assert set(found) == set(wanted)
    for name, value in wanted.items():
        assert found[name] == value, f"{name} after point {point}"


@pytest.mark.parametrize("full", [False, True], ids=["killed", "full"])
@pytest.mark.parametrize("share", [0.0, 0.4, 0.75, 1.0])
def test_some_writes(whole, tmp_path, share, full):
    # Oracle: the same command, never killed. With the first and the last write.
    check(whole, tmp_path / "out", round(share * (whole[-1][full] - 1)), full)


@pytest.mark.long
@pytest.mark.parametrize("full", [False, True], ids=["killed", "full"])
def test_every_write(whole, tmp_path, full):
    for point in range(whole[-1][full]):
        check(whole, tmp_path / "out", point, full)
        shutil.rmtree(tmp_path / "out")


def test_a_kill_after_the_best_is_written_and_before_the_checkpoint(tmp_path, monkeypatch):
    # Oracle: the command that nobody killed. The best policy is ahead of the training that is resumed.
    killing.train(tmp_path / "whole")
    claim, seen = Folder._claim, []

    def killed(folder, claimed):
        seen.append(claimed)
        if claimed == "checkpoint.json" and seen.count("best/checkpoint.json") == 2:
            raise KeyboardInterrupt
        return claim(folder, claimed)

    with monkeypatch.context() as patch:
        patch.setattr(Folder, "_claim", killed)
        with pytest.raises(KeyboardInterrupt):
            killing.train(tmp_path / "cut")
    assert len(checkpoint.read_text(tmp_path / "cut" / "best")["training"]["curve"]) == 2
    assert len(checkpoint.read_text(tmp_path / "cut")["training"]["curve"]) == 1
    killing.train(tmp_path / "cut")
    assert killing.result_of_train(tmp_path / "cut") == killing.result_of_train(tmp_path / "whole")
