"""What a training shows in TensorBoard, over all the processes that it took."""

import re
import time
from pathlib import Path

from torch.utils.tensorboard.writer import SummaryWriter

_NAME = r"events\.out\.tfevents\.(\d+)\..*"


def open_rows(folder: Path, steps: int) -> SummaryWriter:
    """Open TensorBoard's rows to go on after some steps; what an earlier process logged beyond them is taken back.

    TensorBoard reads the files of a folder in the order of their names: by the second in which they were begun, then by
    host and process. Two of one second could be read in the wrong order, so that of the newest is waited out.
    """
    begun = [int(found[1]) for path in folder.iterdir() if (found := re.fullmatch(_NAME, path.name))]
    # A clock that was turned back is not waited for.
    time.sleep(min(max(max(begun, default=0) + 1 - time.time(), 0.0), 1.0))
    return SummaryWriter(str(folder), purge_step=steps + 1)
