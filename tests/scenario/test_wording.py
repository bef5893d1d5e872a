"""Errors of user code in our messages: the line of the user's code, and no raw traceback."""

import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import lissajous_env
from lissajous_env.plugins import import_attribute
from lissajous_env.wording import where_raised

FILES = {
    "plugins": "def act(observation):\n    raise RuntimeError('mine')\n",  # as a file of ours is called
    "numbers_of_mine": "import numpy as np\n\ndef act(observation):\n    return np.zeros((1, 2)) @ np.zeros((3, 1))\n",
}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    for name, source in FILES.items():
        (tmp_path / f"{name}.py").write_text(source)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    for name in FILES:
        sys.modules.pop(name, None)


@pytest.mark.parametrize(("module", "place"), [
    ("plugins", "(plugins.py, line 2)"),
    ("numbers_of_mine", "(numbers_of_mine.py, line 4)"),
])  # fmt: skip
def test_the_innermost_line_of_the_user_is_named(module, place):
    act = import_attribute(f"{module}:act", "it must be it")
    with pytest.raises((RuntimeError, ValueError)) as raised:
        lissajous_env.evaluate(act, "failure", seeds=[0])
    assert where_raised(raised.value).endswith(place)


def test_what_a_library_raises_by_itself_names_its_line():
    with pytest.raises(ValueError, match="fmt") as raised:
        np.savetxt("x", [1.0], fmt=3)
    assert ".py, line" in where_raised(raised.value)


CUDA = """
import lissajous_env
for device in ("cuda", "cuda:0", "cuda:7"):
    try:
        lissajous_env.Simulation("failure", device=device)
    except ValueError as error:
        print(error)
"""


def test_a_machine_without_a_gpu_says_so_in_one_line_and_warp_says_nothing(here):
    # Story: two raw lines of Warp's native code stood above the error. They are written past Python, to the descriptor.
    ended = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(CUDA)], capture_output=True, text=True, timeout=120,
        env={"CUDA_VISIBLE_DEVICES": "", "PATH": "/usr/bin:/bin", "HOME": str(here)},
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, "")
    lines = ended.stdout.splitlines()
    assert len(lines) == 3
    for line, device in zip(lines, ("cuda", "cuda:0", "cuda:7"), strict=True):
        assert line.startswith(
            f"device must be one of those present (cpu), got '{device}'; Warp has found no CUDA driver"
        )
