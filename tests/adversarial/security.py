"""Strangers' folders with pickles in them."""

import contextlib
import io
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from lissajous_env.console.cli import main
from tests.adversarial import Attack, planted

_SHORT = ("--set", "task.duration=1.0")
_TRAIN = (
    "train", "--scenario", "failure", "--worlds", "2", "--rollout", "8", "--batch-size", "80", "--layers", "4",
    "--evaluate-every", "80", "--evaluation-episodes", "1", "--threads", "1", "--teacher", "none", "--rivals", *_SHORT,
)  # fmt: skip
_PLACE = tempfile.TemporaryDirectory(prefix="attacked-")
"""Folder of the attacked folders, until this process ends."""


def _run(arguments: tuple) -> tuple[int | str | None, str]:
    """Exit code and what was said of a command in this process."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            main([str(each) for each in arguments])
        except SystemExit as end:
            return end.code, said.getvalue()
        except Exception as error:
            return None, repr(error)
    return None, said.getvalue()


@cache
def _made(kind: str) -> Path:
    """A sound folder of some kind, made once."""
    folder = Path(_PLACE.name) / kind
    if kind == "policy":
        import training.learned.policy

        shutil.copytree(training.learned.policy.find("learned-intruders"), folder)
    else:
        if kind == "recording":
            folder.mkdir()
        code, said = _run(_first(kind, folder))
        assert code == 0, said
    return folder


def _first(kind: str, folder: Path) -> tuple:
    return {
        "training": (*_TRAIN, "--steps", "80", "--out", folder),
        "benchmark": ("benchmark", "--scenarios", "failure", "--policies", "still", "--episodes", "1", "--out", folder,
                      *_SHORT),
        "recording": ("run", "failure", "still", "--out", folder / "one.npz", *_SHORT),
    }[kind]  # fmt: skip


def _again(kind: str, folder: Path, draw: np.random.Generator) -> tuple:
    """A command that reads the folder."""
    if kind == "training":
        return *_TRAIN, "--steps", "160", "--out", folder
    if kind == "policy":
        out = folder.parent / "out"
        ways = (
            ("run", "failure", folder, "--out", folder.parent / "out.png", *_SHORT),
            ("evaluate", folder, "failure", "--episodes", "1", *_SHORT),
            ("benchmark", "--scenarios", "failure", "--policies", folder, "--episodes", "1", "--out", out, *_SHORT),
        )
        return ways[draw.integers(len(ways))]
    if kind == "recording":
        return "replay", folder / "one.npz", "--out", folder.parent / "out.png"
    return _first(kind, folder)


def _with_pickles(kind: str) -> Callable[[np.random.Generator], str | None]:
    def attempt(draw: np.random.Generator) -> str | None:
        with tempfile.TemporaryDirectory() as place:
            folder, marker = Path(place) / "folder", Path(place) / "opened"
            shutil.copytree(_made(kind), folder)
            files = sorted(path for path in folder.rglob("*") if path.is_file())
            chosen = [files[k] for k in draw.choice(len(files), draw.integers(1, 4), replace=False)]
            form = draw.choice(["plain", "archive", "npz"])
            for path in chosen:
                planted.plant(path, planted.payloads(marker)[form])
            code, said = _run(_again(kind, folder, draw))
            names = ", ".join(str(path.relative_to(folder)) for path in chosen)
            if planted.opened(marker):
                return f"{names}: unpickled"
            if code not in (0, 1, 2) or "Traceback" in said:
                return f"{names}: exit code {code}, {said[-200:]!r}"
        return None

    return attempt


_NEVER = "A pickle in place of any file is never opened; the command works, or prints the reason in one line."
ATTACKS = [
    Attack("pickles in the folder of a training", _NEVER, 20, _with_pickles("training")),
    Attack("pickles in the folder of a policy", _NEVER, 20, _with_pickles("policy")),
    Attack("pickles in the folder of a benchmark", _NEVER, 15, _with_pickles("benchmark")),
    Attack("pickles as a recording", _NEVER, 20, _with_pickles("recording")),
]
