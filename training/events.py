"""TensorBoard files of a training, across the processes that resume it."""

import re
import time
from pathlib import Path

from torch.utils.tensorboard.writer import SummaryWriter

_NAME = r"events\.out\.tfevents\.(\d+)\..*"


def open_rows(folder: Path, steps: int) -> SummaryWriter:
    """Open a TensorBoard file that continues after `steps`; later values of an earlier process are hidden.

    TensorBoard reads the files of a folder by name: first the second of their creation, then host and process. To keep
    the order, this waits until the second of the newest file is over.
    """
    begun = [int(found[1]) for path in folder.iterdir() if (found := re.fullmatch(_NAME, path.name))]
    # At most a second, in case the clock was set back.
    time.sleep(min(max(max(begun, default=0) + 1 - time.time(), 0.0), 1.0))
    return SummaryWriter(str(folder), purge_step=steps + 1)
