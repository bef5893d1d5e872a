"""Work shared by threads: each task is done once in each run; and the number of threads."""

import pytest
import warp as wp

from lissajous_env.device import devices
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.work import Work

TASKS = 24


@wp.kernel
def follow(task: int, before: int, busy: int, marks: wp.array(dtype=int), late: wp.array(dtype=int)):
    """Mark a task as done once more; count it as late where its launch before has not been done as often."""
    if before >= 0 and marks[before] != marks[task] + 1:
        late[task] += 1
    turned = float(0.0)
    for k in range(busy):
        turned = wp.sin(turned + float(k))
    marks[task] += 1 + int(turned > 2.0)


@pytest.mark.parametrize(("threads", "busy"), [(1, 0), (2, 0), (16, 300)])
def test_every_task_is_done_once_and_its_launches_in_their_order(threads, busy):
    # Oracle: the tasks' own marks. Helpers come at any time, or never, and are more than there are cores.
    device = as_device("cpu")
    marks, late = (wp.zeros(2 * TASKS, dtype=wp.int32, device=device) for _ in range(2))

    def launch(task, before):
        inputs = [task, before, busy if task % 5 == 0 else 0, marks, late]
        return wp.launch(follow, 1, inputs, device=device, record_cmd=True)

    with compile_quietly():
        work = Work([[launch(t, -1), launch(TASKS + t, t)] for t in range(TASKS)], device, threads)
    for _ in range(500):
        work()
    assert (marks.numpy() == 500).all()
    assert late.numpy().sum() == 0


@pytest.mark.parametrize(("files", "expected"), [
    ({}, 6),
    ({"cpu.max": "250000 100000\n"}, 3),
    ({"cpu.max": "5000 100000\n"}, 1),
    ({"cpu/cpu.cfs_quota_us": "200000\n", "cpu/cpu.cfs_period_us": "100000\n"}, 2),
])  # fmt: skip
def test_as_many_cores_as_the_process_may_use(tmp_path, monkeypatch, files, expected):
    # Oracle: what Linux says of control groups, of both versions; the process is bound to six cores.
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(devices, "_CONTAINER", tmp_path)
    monkeypatch.setattr(devices.os, "sched_getaffinity", lambda _: range(6), raising=False)
    assert devices.cores() == expected
