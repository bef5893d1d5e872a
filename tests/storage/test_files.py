"""Files: users' files stay untouched, links are not followed, JSON is strict, and a full disk is survived."""

import errno
import json
import os
from contextlib import closing
from pathlib import Path

import pytest
from rich.console import Console

from baselines.benchmark.running import run
from baselines.benchmark.types import Benchmark
from baselines.commands.reproduce import reproduce
from lissajous_env.storage import files
from lissajous_env.storage.files import check_writable_file, parse_json, read_bytes, replacing, write_atomically
from lissajous_env.storage.folder import LIST, Folder, Journal

QUIET = Console(quiet=True)
NEIGHBOURS = (
    ".env.tmpl", ".x.tmp", ".settings.1234.tmp.json", ".lock", ".lissajous-0123456789abcdef.json", "notes.csv", ".tmp",
    "weights-abc.safetensors", "best.txt",
)  # fmt: skip


def benchmark(out):
    run(Benchmark(("failure",), ("still",), 2, out=out, overrides={"task.duration": 0.3}), console=QUIET)


def train(out):
    pytest.importorskip("torch")
    from training.settings import TrainingSettings
    from training.trainer import train

    settings = TrainingSettings(
        "failure", steps=20, worlds=2, rollout=8, minibatch=32, hidden=8, features=8, episodes=1, threads=1,
        evaluate_every=80, out=out, overrides={"task.duration": 0.2},
    )  # fmt: skip
    train(settings, QUIET)


def theorem(out):
    reproduce(("theorem2",), out=out)


COMMANDS = {"benchmark": benchmark, "train": train, "reproduce": theorem}
each_command = pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)


@each_command
def test_files_of_the_user_stay_as_they_are(tmp_path, command):
    # Twice: the second time there is a list of what was written, and it is gone through.
    for name in NEIGHBOURS:
        (tmp_path / name).write_text(f"mine: {name}")
    for _ in range(2):
        command(tmp_path)
        assert {name: (tmp_path / name).read_text() for name in NEIGHBOURS} == {n: f"mine: {n}" for n in NEIGHBOURS}


@pytest.mark.parametrize(("command", "name", "kind"), [
    (benchmark, "settings.json", "file"), (benchmark, "episodes.jsonl", "link"),
    (benchmark, "report.html", "folder"), (theorem, "README.md", "broken link"), (train, "best", "broken link"),
])  # fmt: skip
def test_a_file_of_the_user_with_the_name_of_a_result_is_refused_at_once(tmp_path, command, name, kind):
    outside, out = tmp_path / "outside", tmp_path / "out"
    out.mkdir()
    outside.write_text("mine")
    if kind == "file":
        (out / name).write_text("mine")
    elif kind == "folder":
        (out / name).mkdir()
    else:
        (out / name).symlink_to(outside if kind == "link" else tmp_path / "nothing")
    with pytest.raises(ValueError, match=rf"folder without a {name} that another program wrote, got .*{name}"):
        command(out)
    assert [path.name for path in out.iterdir()] == [name], "nothing was begun"
    assert outside.read_text() == "mine"
    assert not (tmp_path / "nothing").exists()
    if kind == "file":
        assert (out / name).read_text() == "mine"


@pytest.mark.parametrize(("command", "name"), [(benchmark, "episodes.jsonl"), (theorem, "README.md")])
def test_a_result_that_became_a_link_is_refused(tmp_path, command, name):
    outside, out = tmp_path / "outside", tmp_path / "out"
    command(out)
    os.replace(out / name, outside)
    before = outside.read_bytes()
    (out / name).symlink_to(outside)
    with pytest.raises(ValueError, match=rf"{name} must be a file, got a link"):
        command(out)
    assert outside.read_bytes() == before


@pytest.mark.parametrize("name", ["episodes.jsonl", LIST])
def test_a_file_that_grows_must_not_have_a_second_name(tmp_path, name):
    # Two names of one file: what is appended to one would be appended to the other.
    benchmark(tmp_path / "out")
    os.link(tmp_path / "out" / name, tmp_path / "kept")
    before = (tmp_path / "kept").read_bytes()
    with pytest.raises(ValueError, match=rf"{name} must be a plain file, got a hard link"):
        benchmark(tmp_path / "out")
    assert (tmp_path / "kept").read_bytes() == before


def test_out_may_be_a_link_to_a_folder(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    for _ in range(2):
        theorem(tmp_path / "out")
    assert (tmp_path / "disk" / LIST).is_file()


@pytest.mark.parametrize("text", ["mine", '{"a": 1}\n', "\n", "[]"])
def test_a_list_that_is_not_ours_is_not_touched(tmp_path, text):
    (tmp_path / LIST).write_text(text)
    with pytest.raises(ValueError, match=r"\.lissajous\.jsonl must be a list of the files written here"):
        Folder(tmp_path)
    assert (tmp_path / LIST).read_text() == text


@pytest.mark.parametrize("name", ["../x", "/x", "a/../../x", "a/b/c", "", "..", LIST, "C:x", "a\\b"])
def test_no_name_leads_out_of_the_folder(tmp_path, name):
    with Folder(tmp_path / "out") as folder, pytest.raises(ValueError, match="must be"):
        folder.write(name, "x")
    (tmp_path / "x").write_text("mine")
    with open(tmp_path / "out" / LIST, "a") as file:
        file.write(json.dumps({"wrote": name}) + "\n")
    with pytest.raises(ValueError, match="name of a result must be that of a file in its folder"):
        Folder(tmp_path / "out")
    assert (tmp_path / "x").read_text() == "mine"


def test_only_what_was_written_is_removed(tmp_path):
    with Folder(tmp_path) as folder:
        folder.write("a", "1")
        (tmp_path / "b").write_text("mine")
        folder.remove("a")
        folder.remove("b")
        assert folder.written == ()
        (tmp_path / "a").write_text("mine")
        with pytest.raises(ValueError, match="that another program wrote"):
            folder.write("a", "2")
    assert [(tmp_path / name).read_text() for name in "ab"] == ["mine", "mine"]


def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path):
    with Folder(tmp_path) as folder:
        folder.write("a.json", "whole")
    (tmp_path / ".lissajous-writing.json").write_text("half")
    (tmp_path / ".lissajous-1.json").write_text("mine")
    with Folder(tmp_path):
        assert sorted(path.name for path in tmp_path.iterdir()) == [".lissajous-1.json", LIST, "a.json"]


@pytest.mark.parametrize("torn", ["", '{"lissa', '{"lissajous": 1}\n{"wro'])
def test_a_list_that_a_kill_left_half_written_is_gone_on_with(tmp_path, torn):
    (tmp_path / LIST).write_text(torn)
    with Folder(tmp_path) as folder:
        folder.write("a", "1")
    with Folder(tmp_path) as folder:
        assert folder.written == ("a",)


def test_a_temporary_file_hits_no_file(tmp_path, monkeypatch):
    monkeypatch.setattr(files.secrets, "token_hex", lambda size: "0")
    (tmp_path / ".lissajous-0.txt").write_text("mine")
    with pytest.raises(OSError, match="File exists"):
        write_atomically(tmp_path / "a.txt", "x")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(".lissajous-0.txt", "mine")]


def test_replacing_a_link_leaves_its_target(tmp_path):
    (tmp_path / "target").write_text("mine")
    (tmp_path / "link.csv").symlink_to(tmp_path / "target")
    with replacing(tmp_path / "link.csv") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "target").read_text() == "mine"
    assert not (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "link.csv").stat().st_mode == (tmp_path / "target").stat().st_mode


@pytest.mark.parametrize(("out", "words"), [
    ("nowhere/a.csv", "in an existing folder, got"), ("folder", "a file, got the folder"),
    ("file/a.csv", "in an existing folder, got"), ("/proc/a.csv", "in a folder that can be written to, got"),
])  # fmt: skip
def test_a_file_that_cannot_be_written_is_found_before_any_work(tmp_path, out, words):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ValueError, match=f"out must be {words}"):
        check_writable_file(tmp_path / out)
    check_writable_file(tmp_path / "folder" / "a.csv")
    check_writable_file(tmp_path / "file")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder"]
    assert (tmp_path / "file").read_text() == "mine"


@each_command
@pytest.mark.parametrize("out", ["/proc/out", "file", "file/out"])
def test_a_folder_that_cannot_be_written_is_found_before_any_work(tmp_path, command, out):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ValueError, match="out must be a folder that can be written to, got"):
        command(tmp_path / out)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize(("text", "words"), [
    ('{"a": NaN}', "only finite numbers, got NaN"),
    ("1e400", "only finite numbers, got 1e400"),
    ("-" + 5000 * "9", "only finite numbers, got -999"),
    (101 * "[" + 101 * "]", "nest at most 100 levels"),
    (100_000 * '{"a":' + "1" + 100_000 * "}", "nest at most 100 levels"),
    ("", "Expecting value"), ("{", "Expecting"),
])  # fmt: skip
def test_json_is_read_strictly(tmp_path, text, words):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ValueError, match=rf"a\.json is damaged: .*{words}") as error:
        parse_json(read_bytes(tmp_path / "a.json", 10**6), tmp_path / "a.json")
    assert len(str(error.value)) < 300 + len(str(tmp_path))


def test_what_is_no_plain_file_is_not_read(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "a")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "bytes").write_bytes(b'"\xff"')
    (tmp_path / "large").write_text(100 * " ")
    for name, words in (
        ("missing", "is missing"), ("link", "must be a plain file, got a link"), (".", "must be a plain file"),
        ("pipe", "must be a plain file"), ("bytes", "is damaged"), ("large", "must be at most 99 bytes, got 100"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            parse_json(read_bytes(tmp_path / name, 99), tmp_path / name)


@pytest.mark.parametrize("line", ['{"a": NaN}', "[1]", "3", 500 * "[" + 500 * "]"])
def test_a_last_line_that_no_kill_can_have_left_is_refused(tmp_path, line):
    (tmp_path / "journal").write_text('{"a": 1}\n' + line + "\n")
    before = (tmp_path / "journal").read_text()
    with pytest.raises(ValueError, match=r"journal, line 2 is damaged: .*delete that line"):
        Journal(tmp_path / "journal")
    assert (tmp_path / "journal").read_text() == before


@pytest.mark.parametrize("call", ["write", "fsync"])
def test_a_full_disk_leaves_whole_lines_alone(tmp_path, monkeypatch, call):
    write = os.write

    def full(descriptor, *data):
        if data:
            write(descriptor, data[0][:3])
        raise OSError(errno.ENOSPC, "No space left on device")

    with closing(Journal(tmp_path / "journal")) as journal:
        journal.append([{"a": 1}])
        with monkeypatch.context() as patch:
            patch.setattr(os, call, full)
            with pytest.raises(OSError, match=r"No space left on device: '.*journal'"):
                journal.append([{"a": 2}])
        journal.append([{"a": 3}])
    with closing(Journal(tmp_path / "journal")) as journal:
        assert journal.entries == [{"a": 1}, {"a": 3}]


@pytest.mark.parametrize(("place", "call"), [(Path, "write_bytes"), (os, "fsync"), (os, "replace")])
def test_a_full_disk_leaves_the_file_before(tmp_path, monkeypatch, place, call):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with Folder(tmp_path) as folder:
        folder.write("a.json", "old")
        before = sorted(path.name for path in tmp_path.iterdir())
        with monkeypatch.context() as patch:
            patch.setattr(place, call, full)
            with pytest.raises(OSError, match=r"^\[Errno 28\] No space left on device: '.*a\.json'"):
                folder.write("a.json", "new")
        assert (tmp_path / "a.json").read_text() == "old"
        assert sorted(path.name for path in tmp_path.iterdir()) == before
