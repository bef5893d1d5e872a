"""The command `lissajous`, for tests: called in this process, or in one of its own."""

import os
import subprocess
import sys

import pytest

from lissajous_env.console.cli import main


def called(capsys, *arguments):
    """Exit code, stdout and stderr of a command in this process."""
    with pytest.raises(SystemExit) as ended:
        main([*map(str, arguments)])
    return (ended.value.code, *capsys.readouterr())


def lissajous(*arguments, width=120, **options):
    environment = os.environ | {"COLUMNS": str(width)}
    command = [sys.executable, "-m", "lissajous_env", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60, **options)
