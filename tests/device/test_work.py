"""Work shared by threads: each task is done once, after the tasks of earlier groups."""

import pytest
import warp as wp

from lissajous_env.device import devices
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.work import Work

TASKS, GROUPS = 24, 6


@wp.kernel
def follow(task: int, group: int, busy: int, marks: wp.array2d(dtype=int), late: wp.array(dtype=int)):
    """Mark a task as done once more; count it as late where one of the group before has not been done as often."""
    for other in range(marks.shape[1]):
        if group > 0 and marks[group - 1, other] != marks[group, task] + 1:
            late[task] += 1
    turned = float(0.0)
    for k in range(busy):
        turned = wp.sin(turned + float(k))
    marks[group, task] += 1 + int(turned > 2.0)


class Followed:
    """Work whose tasks look at those of the group before them."""

    def __init__(self, threads, busy=0):
        device = as_device("cpu")
        self.marks = wp.zeros((GROUPS, TASKS), dtype=wp.int32, device=device)
        self.late = wp.zeros(TASKS, dtype=wp.int32, device=device)

        def launch(group, task):
            inputs = [task, group, busy if task % 5 == 0 else 0, self.marks, self.late]
            return wp.launch(follow, 1, inputs, device=device, record_cmd=True)

        with compile_quietly():
            self.work = Work([[[launch(g, t)] for t in range(TASKS)] for g in range(GROUPS)], device, threads)

    def check(self, runs):
        assert (self.marks.numpy() == runs).all()
        assert self.late.numpy().sum() == 0


@pytest.mark.parametrize(("threads", "busy"), [(1, 0), (2, 0), (3, 300), (16, 300)])
def test_every_task_is_done_once_and_after_those_of_the_group_before(threads, busy):
    # Oracle: the tasks' own marks. Helpers come at any time, or never, and are more than there are cores.
    followed = Followed(threads, busy)
    for _ in range(500):
        followed.work()
    followed.check(500)


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, 6),
        ({"cpu.max": "max 100000\n"}, 6),
        ({"cpu.max": "250000 100000\n"}, 3),
        ({"cpu.max": "5000 100000\n"}, 1),
        ({"cpu.max": "nonsense"}, 6),
        ({"cpu/cpu.cfs_quota_us": "200000\n", "cpu/cpu.cfs_period_us": "100000\n"}, 2),
    ],
)
def test_as_many_cores_as_the_process_may_use(tmp_path, monkeypatch, files, expected):
    # Oracle: what Linux says of control groups, of both versions; the process is bound to six cores.
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(devices, "_CONTAINER", tmp_path)
    monkeypatch.setattr(devices.os, "sched_getaffinity", lambda _: range(6), raising=False)
    assert devices.cores() == expected
