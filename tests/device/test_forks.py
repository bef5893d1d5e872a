"""Forks with threads, nested calls, and threads with small stacks: no deadlock, and no partial results."""

import subprocess
import sys
import textwrap
import threading

import numpy as np
import pytest

import lissajous_env

BEGIN = """
import os, signal, sys, threading, time
import numpy as np
import lissajous_env
import baselines

def zeros(simulation):
    return np.zeros(simulation.action_shape, dtype=np.float32)

def ended(child, seconds=30):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status
        time.sleep(0.005)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "hangs"
"""


def run(code, *arguments):
    """Return the output of a process that runs some code; None if it does not end."""
    program = BEGIN + textwrap.dedent(code)
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[-2000:] or done.returncode
    return done.stdout.strip()


def test_a_child_forked_while_other_threads_are_busy():
    # Oracle: the exit status of each child, which has to end. It makes, steps and acts itself; what another thread was
    # working on is refused by name. The threads step, make and act.
    code = """
    simulation = lissajous_env.Simulation("experiment", 64, threads=2)
    policy, observation = baselines.make("kuramoto-mpcc", "experiment", 64), simulation.observation
    simulation.step(policy.act(observation).numpy())

    def go_on(work):
        while not stopping:
            work()

    stopping = False
    works = (
        lambda: simulation.step(zeros(simulation)),
        lambda: lissajous_env.Simulation("experiment"),
        lambda: policy.act(observation),
    )
    threads = [threading.Thread(target=go_on, args=(work,)) for work in works]
    for thread in threads:
        thread.start()
    statuses = []
    for _ in range(8):
        time.sleep(0.02)
        if (child := os.fork()) == 0:
            try:
                simulation.step(policy.act(observation).numpy())
            except RuntimeError as error:
                assert "nor a process that was forked meanwhile" in str(error)
            wide = lissajous_env.scenario("experiment", **{"robot.radius": 0.06})
            other = lissajous_env.Simulation(wide, 16, threads=2)
            other.step(zeros(other))
            os._exit(0)
        statuses.append(ended(child))
        if "hangs" in statuses:
            break
    stopping = True
    for thread in threads:
        thread.join()
    print(set(statuses))
    """
    assert run(code) == "{0}"


def test_what_another_thread_works_on_is_refused_in_the_child_and_an_extension_may_fork():
    # Oracle: the words of the child's error; another simulation works there, and the same one in the parent. Where an
    # extension forks, parent and child both finish the step that they are in.
    code = """
    entered, leave, children = threading.Event(), threading.Event(), []

    @lissajous_env.reward_term()
    def waits(world):
        if entered.is_set() is False:
            entered.set()
            leave.wait()
        return np.zeros(world.robots.speed.shape)

    @lissajous_env.reward_term()
    def forks(world):
        if not children:
            children.append(os.fork())
        return np.zeros(world.robots.speed.shape)

    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", extensions=[waits]))
    thread = threading.Thread(target=lambda: simulation.step(zeros(simulation)))
    thread.start()
    entered.wait()
    if (child := os.fork()) == 0:
        lissajous_env.Simulation("experiment").step(zeros(simulation))
        try:
            simulation.step(zeros(simulation))
        except RuntimeError as error:
            print(error, flush=True)
            os._exit(0)
        os._exit(1)
    print(ended(child), flush=True)
    leave.set()
    thread.join()
    simulation.step(zeros(simulation))
    forking = lissajous_env.Simulation(lissajous_env.scenario("experiment", extensions=[forks]))
    for _ in range(3):
        forking.step(zeros(forking))
    taken = int(forking.clock.step.numpy()[0])
    if children[0] == 0:
        os._exit(0 if taken == 3 else 1)
    print(taken, ended(children[0]))
    """
    words = "a signal handler or an extension must not call it, nor a process that was forked meanwhile"
    assert run(code).splitlines() == [f"the simulation is running: {words}", "0", "3 0"]


@pytest.mark.parametrize("call", ["step", "reset"])
def test_an_extension_that_calls_its_own_simulation_is_refused(call):
    # Oracle: the error; afterwards the simulation works as before.
    inside = []

    @lissajous_env.reward_term()
    def nosy(world):
        if inside:
            getattr(simulation, call)(*([np.zeros(simulation.action_shape)] if call == "step" else []))
        return np.zeros(world.robots.speed.shape)

    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", extensions=[nosy]))
    action = np.zeros(simulation.action_shape, dtype=np.float32)
    inside.append(True)
    with pytest.raises(ValueError, match="nosy failed: RuntimeError: the simulation is running: a signal handler"):
        simulation.step(action)
    inside.clear()
    simulation.reset()
    simulation.step(action)
    assert simulation.clock.step.numpy()[0] == 1


def test_threads_with_small_stacks_make_and_step(tmp_path):
    # Oracle: it ends; a stack that is too small ends the process. The user of a kernel has loaded it with the 256 KiB
    # of stack for tiles that Warp reserves; a stage is compiled without.
    (tmp_path / "mine.py").write_text(
        textwrap.dedent("""
        import lissajous_env, warp as wp
        from lissajous_env.device.stage import ROBOT, stage

        @lissajous_env.reward_term()
        @stage(ROBOT, writes="value_out")
        def fast(w, i, robots, value_out: wp.array2d(dtype=float)):
            value_out[w, i] = robots.speed[w, i]
        """)
    )
    code = """
    sys.path.insert(0, sys.argv[1])
    import mine, warp as wp
    wp.load_module(mine)
    before = {key: each.module_hash for key, each in mine.fast.run.module.execs.items()}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", extensions=[mine.fast]))
    after = {key: each.module_hash for key, each in mine.fast.run.module.execs.items()}

    def work():
        simulation.step(zeros(simulation))
        many = lissajous_env.Simulation("intruders", 40, threads=3)
        policy = baselines.make("kuramoto-mpcc-safe", "intruders", 40)
        many.step(policy.act(many.observation).numpy())

    threading.stack_size(128 << 10)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    print(len(before), before == after, int(simulation.clock.step.numpy()[0]))
    """
    assert run(code, tmp_path).splitlines()[-1] == "1 False 1"


def test_threads_that_step_one_simulation_take_turns():
    # Oracle: as many steps as all have taken.
    simulation = lissajous_env.Simulation("experiment", 8)

    def go_on():
        for _ in range(100):
            simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))

    threads = [threading.Thread(target=go_on) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert int(simulation.clock.step.numpy()[0]) == 300
