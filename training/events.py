"""Logs of a training: TensorBoard files across the processes that resume it, and other writers of the library."""

import contextlib
import re
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from stable_baselines3.common.logger import KVWriter, Logger
from torch.utils.tensorboard.writer import SummaryWriter

_NAME = r"events\.out\.tfevents\.(\d+)\..*"


def open_rows(folder: Path, steps: int) -> SummaryWriter:
    """Open a TensorBoard file that continues after `steps`; later values of an earlier process are hidden.

    TensorBoard reads the files of a folder by name: first the second of their creation, then host and process. To keep
    the order, this waits until the second of the newest file is over.
    """
    begun = [int(match[1]) for path in folder.iterdir() if (match := re.fullmatch(_NAME, path.name))]
    # At most a second, in case the clock was set back.
    time.sleep(min(max(max(begun, default=0) + 1 - time.time(), 0.0), 1.0))
    return SummaryWriter(str(folder), purge_step=steps + 1)


@contextlib.contextmanager
def logging_to(folder: Path, steps: int, writers: Sequence[KVWriter]) -> Iterator[Logger]:
    """Log to TensorBoard and to the writers; values logged after `steps` by an earlier process are hidden.

    Raises:
        OSError: the disk is full; the error names the folder.
    """
    before = threading.excepthook

    def quiet(arguments: threading.ExceptHookArgs) -> None:
        # A full disk is reported by the next row; the writing thread need not print its traceback.
        if not isinstance(arguments.exc_value, OSError):
            before(arguments)

    threading.excepthook = quiet
    try:
        with contextlib.closing(Logger(str(folder), [_Rows(folder, steps), *writers])) as logger:
            yield logger
    except OSError as error:
        if error.filename is None:
            raise OSError(error.errno, error.strerror or str(error), str(folder)) from error
        raise
    finally:
        threading.excepthook = before


class _Rows(KVWriter):
    """Writer of TensorBoard's rows."""

    def __init__(self, folder: Path, steps: int):
        self._rows = open_rows(folder, steps)

    def write(self, key_values: dict, key_excluded: dict, step: int = 0) -> None:
        """Write the values of a step."""
        for name, value in key_values.items():
            self._rows.add_scalar(name, value, step)
        self._rows.flush()

    def close(self) -> None:
        """Close the file."""
        self._rows.close()
