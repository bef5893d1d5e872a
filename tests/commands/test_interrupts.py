"""Ctrl-C at every moment of a command: exit code 130 and one line, without a traceback."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import lissajous_env

ROOT = Path(lissajous_env.__file__).parents[1]
PRESSED = """
import atexit, os, signal, sys

MOMENT = os.environ["MOMENT"]

def press():
    os.kill(os.getpid(), signal.SIGINT)

class Presses:
    def find_spec(self, name, path=None, target=None):
        if name == MOMENT:
            sys.meta_path.remove(self)
            press()

if MOMENT == "exit":
    atexit.register(press)
sys.meta_path.insert(0, Presses())
"""


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize(
    ("moment", "by_script"),
    [("numpy", True), ("lissajous_env.console.cli", False), ("rich.table", True), ("exit", False)],
)
def test_ctrl_c_while_a_command_imports_or_ends_is_one_line(moment, by_script, tmp_path):
    # Story: the signal arrives in the midst of an import, where Python would print the stack of all imports.
    (tmp_path / "sitecustomize.py").write_text(PRESSED)
    script = tmp_path / "lissajous"
    script.write_text("from lissajous_env.console.cli import main\nmain()\n")
    start = [str(script)] if by_script else ["-m", "lissajous_env"]
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}", "MOMENT": moment}
    done = subprocess.run([sys.executable, *start, "scenarios"], env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


def test_importing_the_package_leaves_ctrl_c_as_it_is():
    # Story: a program of a user that has its own use for the signal, or none.
    program = "import signal; before = signal.getsignal(2); import lissajous_env; assert signal.getsignal(2) is before"
    done = subprocess.run([sys.executable, "-c", program], env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 0
