"""The command `lissajous`, for tests: called in this process."""

import pytest

from lissajous_env.console.cli import main


def called(capsys, *arguments):
    """Exit code, stdout and stderr of a command in this process."""
    with pytest.raises(SystemExit) as ended:
        main([*map(str, arguments)])
    return (ended.value.code, *capsys.readouterr())
