"""Work shared by threads: each task is done once, after the tasks of earlier groups."""

import gc
import os
import threading

import numpy as np
import pytest
import warp as wp

from lissajous_env.device import devices
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.work import Work, shared_launch

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


@pytest.mark.parametrize("threads", [1, 2, 3, 16])
@pytest.mark.parametrize("busy", [0, 300])
def test_every_task_is_done_once_and_after_those_of_the_group_before(threads, busy):
    # Oracle: the tasks' own marks. Helpers come at any time, or never, and are more than there are cores.
    followed = Followed(threads, busy)
    for _ in range(500):
        followed.work()
    followed.check(500)


@pytest.mark.long
def test_helpers_go_from_work_to_work():
    # Oracle: as above, of work that takes turns and is forgotten at any time.
    for _ in range(20):
        pair = Followed(4), Followed(3, 100)
        for _ in range(10):
            for each in pair:
                each.work()
        for each in pair:
            each.check(10)
        del pair
        gc.collect()


def test_threads_of_a_user_may_do_the_same_work_and_their_own():
    # Oracle: as above. The same work is done by one after the other.
    common, own = Followed(3, 50), [Followed(3, 50) for _ in range(4)]

    def run(mine):
        for _ in range(100):
            mine.work()
            common.work()

    threads = [threading.Thread(target=run, args=[each]) for each in own]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    common.check(400)
    for each in own:
        each.check(100)


def test_a_fork_has_helpers_of_its_own():
    # Oracle: the child's exit status. The helpers of its parent are not there.
    followed = Followed(3)
    followed.work()
    if (child := os.fork()) == 0:
        for _ in range(50):
            followed.work()
        os._exit(0 if (followed.marks.numpy() == 51).all() else 1)
    assert os.waitpid(child, 0)[1] == 0
    followed.work()
    followed.check(2)


@wp.kernel
def double(first: int, given: wp.array(dtype=float), taken: wp.array(dtype=float)):
    """Double a number."""
    k = first + wp.tid()
    taken[k] = 2.0 * given[k]


@pytest.mark.parametrize(("size", "threads"), [(1, 4), (1000, 1), (1000, 4), (7, 7)])
def test_a_launch_is_shared_and_its_arguments_may_change(size, threads):
    # Oracle: NumPy.
    device, rng = as_device("cpu"), np.random.default_rng(0)
    given = [wp.array(rng.uniform(size=size), dtype=wp.float32, device=device) for _ in range(2)]
    taken = wp.zeros(size, dtype=wp.float32, device=device)
    with compile_quietly():
        work = shared_launch(double, size, lambda low: [low, given[0]], [taken], device, threads, 10)
    assert len(work.launches) == max(1, min(4 * threads if threads > 1 else 1, size // 10))
    for each in given:
        work.set_argument(1, each)
        work()
        assert (taken.numpy() == 2 * each.numpy()).all()


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, 6),
        ({"cpu.max": "max 100000\n"}, 6),
        ({"cpu.max": "250000 100000\n"}, 3),
        ({"cpu.max": "900000 100000\n"}, 6),
        ({"cpu.max": "5000 100000\n"}, 1),
        ({"cpu.max": "nonsense"}, 6),
        ({"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, 6),
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
