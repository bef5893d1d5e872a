"""Ctrl-C at every moment of a command: exit code 130 and one line, without a traceback."""

import gc
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import lissajous_env
from lissajous_env.console import interrupts

ROOT = Path(lissajous_env.__file__).parents[1]
PRESSED = """
import atexit, os, signal, sys

MOMENT = os.environ["MOMENT"]

def press(*_, kill=os.kill, pid=os.getpid(), number=signal.SIGINT):
    kill(pid, number)  # also when the modules are cleared

class Presses:
    __del__ = press
    def find_spec(self, name, path=None, target=None):
        if name == "lissajous_env.console.cli":
            sys.meta_path.remove(self)
            atexit.register(press) if MOMENT == "exit" else press()

sys.presses = Presses()
if MOMENT != "last":
    sys.meta_path.insert(0, sys.presses)
"""


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize(("moment", "by_script", "ends"), [
    ("import", True, (130, "interrupted\n")), ("exit", False, (130, "interrupted\n")), ("last", False, (0, "")),
])  # fmt: skip
def test_ctrl_c_while_a_command_imports_or_ends_is_one_line(moment, by_script, ends, tmp_path):
    # Story: Python would print the stack of an import; at the end, the default action of the signal would end it.
    (tmp_path / "sitecustomize.py").write_text(PRESSED)
    script = tmp_path / "lissajous"
    script.write_text("from lissajous_env.console.cli import main\nmain()\n")
    start = [str(script)] if by_script else ["-m", "lissajous_env"]
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}", "MOMENT": moment}
    done = subprocess.run([sys.executable, *start, "--version"], env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == ends


@pytest.mark.usefixtures("ctrl_c")
def test_a_program_of_a_user_has_ctrl_c_as_it_is(monkeypatch):
    for name in ("multiprocessing.spawn", "multiprocessing.forkserver"):  # which other tests may have imported
        monkeypatch.delitem(sys.modules, name, raising=False)
    for arguments, is_ours in ((["program.py"], False), (["/usr/bin/lissajous", "scenarios"], True)):
        monkeypatch.setattr(sys, "argv", arguments)
        interrupts._watch()
        assert (signal.getsignal(signal.SIGINT) is interrupts._end) == is_ours == (not gc.isenabled())
        gc.enable()
    with interrupts.raised():
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.getsignal(signal.SIGINT) is interrupts._end
