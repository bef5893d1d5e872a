"""Threads, forks and calls inside calls: nothing hangs, crashes or is half done."""

import signal
import subprocess
import sys
import textwrap
import time
from typing import Any

import numpy as np

import lissajous_env
from tests.adversarial import Attack
from tests.adversarial.terminal import pick

_SECONDS = 400
_BEGIN = """
import os, signal, sys, threading, time
import numpy as np
import baselines, lissajous_env

def zeros(simulation):
    return np.zeros(simulation.action_shape, dtype=np.float32)
"""
_FORKS = """
simulation = lissajous_env.Simulation({scenario!r}, {worlds}, threads={threads})
policy = baselines.make({policy!r}, {scenario!r}, {worlds})
actions = policy.act(simulation.observation).numpy()
stopping, statuses = False, []

def go_on():
    while not stopping:
        {busy}

def child():
    if (forked := os.fork()) == 0:
        try:
            simulation.step(policy.act(simulation.observation).numpy())
        except RuntimeError as error:
            assert "was running in another thread when this process was forked" in str(error)
        lissajous_env.Simulation({scenario!r}, 2).step(actions[:2])
        os._exit(0)
    return forked

others = [threading.Thread(target=go_on) for _ in range({others})]
for each in others:
    each.start()
for _ in range(5):
    time.sleep({pause})
    forked, until, status = child(), time.monotonic() + 60, None
    while status is None and time.monotonic() < until:
        done, status = os.waitpid(forked, os.WNOHANG)
        if not done:
            status = None
            time.sleep(0.005)
    if status is None:
        os.kill(forked, signal.SIGKILL)
        os.waitpid(forked, 0)
    statuses.append("hangs" if status is None else status)
stopping = True
for each in others:
    each.join()
print("held" if set(statuses) == {{0}} else statuses)
"""
_STACK = """
def work():
    simulation = lissajous_env.Simulation({scenario!r}, {worlds}, threads={threads})
    policy = baselines.make({policy!r}, {scenario!r}, {worlds})
    for _ in range(3):
        simulation.step(policy.act(simulation.observation).numpy())
    print("held")

threading.stack_size({size} << 10)
thread = threading.Thread(target=work)
thread.start()
thread.join()
"""
_BUSY = (
    "simulation.step(actions)", "lissajous_env.Simulation('ideal')", "policy.act(simulation.observation)",
    "lissajous_env.scenario('rough').resolve()", "simulation.reset()",
)  # fmt: skip
_POLICIES = {"experiment": "kuramoto-mpcc", "intruders": "sweep-safe", "ideal": "kuramoto", "rough": "kuramoto-gvf"}


def _said(code: str, **drawn: Any) -> str | None:
    """Run code with what was drawn in a process of its own: None where it ends with `held`."""
    program = _BEGIN + textwrap.dedent(code).format(**drawn)
    try:
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        return f"{drawn}: hangs"
    if done.returncode == 0 and done.stdout.strip() == "held":
        return None
    return f"{drawn}: exit {done.returncode}, {(done.stdout + done.stderr)[-300:]}"


def _drawn(draw: np.random.Generator) -> dict[str, Any]:
    scenario = pick(draw, list(_POLICIES))
    worlds, threads = int(draw.choice([2, 16, 64, 200])), int(draw.integers(1, 5))
    return {"scenario": scenario, "policy": _POLICIES[scenario], "worlds": worlds, "threads": threads}


def forks(draw: np.random.Generator) -> str | None:
    """Fork while threads step, reset, make and act; each child steps, acts and makes."""
    busy, others, pause = pick(draw, _BUSY), int(draw.integers(1, 4)), float(draw.uniform(0, 0.03))
    return _said(_FORKS, **_drawn(draw), busy=busy, others=others, pause=pause)


def stacks(draw: np.random.Generator) -> str | None:
    """Make, act and step in a thread with a small stack."""
    return _said(_STACK, **_drawn(draw), size=int(draw.choice([64, 96, 128, 192, 256, 384, 512, 768])))


def calls_inside(draw: np.random.Generator) -> str | None:
    """Call a simulation from its own extension: refused, and it continues afterwards as if nothing had been."""
    call, late = pick(draw, ["step", "advance", "reset", "load_state"]), int(draw.integers(1, 5))
    inside: list[Any] = []

    def nosy(world: Any) -> Any:
        if inside:
            given = {"step": [np.zeros(simulation.action_shape)], "load_state": [inside[0]]}.get(call, [])
            getattr(simulation, call)(*given)
        return np.zeros(world.robots.speed.shape)

    kind = pick(draw, [lissajous_env.reward_term, lissajous_env.observation_entry])
    simulation = lissajous_env.Simulation(lissajous_env.scenario("rough", extensions=[kind()(nosy)]), 2)
    for _ in range(late):
        simulation.step(np.zeros(simulation.action_shape))
    saved = simulation.save_state()
    inside.append(saved)
    try:
        simulation.step(np.zeros(simulation.action_shape))
        return f"{call} inside a step was taken"
    except RuntimeError as error:
        if "is running in" not in str(error):
            return f"{call} inside a step: {error}"
    inside.clear()
    simulation.load_state(saved)
    simulation.step(np.zeros(simulation.action_shape))
    steps = simulation.clock.step.numpy()
    return None if (steps == late + 1).all() else f"after {call} inside a step {steps} steps were taken"


def signals(draw: np.random.Generator) -> str | None:
    """Step in a signal handler what is being stepped: it ends, and each call is taken or refused."""
    simulation = lissajous_env.Simulation("rough", int(draw.choice([1, 50, 400])), threads=int(draw.integers(1, 4)))
    zeros = np.zeros(simulation.action_shape, dtype=np.float32)
    taken, other = [0], []

    def step(*_: Any) -> None:
        try:
            simulation.step(zeros)
            taken[0] += 1
        except RuntimeError as error:
            other.extend([] if "is running in" in str(error) else [str(error)])

    before = signal.signal(signal.SIGALRM, step)
    signal.setitimer(signal.ITIMER_REAL, 0.001, float(draw.uniform(0.0002, 0.005)))
    try:
        until = time.monotonic() + 0.5
        while time.monotonic() < until:
            step()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    steps, wanted = int(simulation.clock.step.numpy()[0]), min(taken[0], simulation.scenario.task.steps)
    return f"{other[:1]}, {steps} steps of {wanted}" if other or steps != wanted else None


ATTACKS = [
    Attack(
        "forks under threads",
        "Every child can create simulations and step them; unfinished work is rejected by name, and nothing hangs.",
        12,
        forks,
    ),
    Attack(
        "threads with small stacks", "A thread with a stack of 64 KiB or more can create, act and step.", 16, stacks
    ),
    Attack("calls inside a step", "The call is rejected by name, and the simulation continues.", 40, calls_inside),
    Attack("signal handlers that step", "Nothing hangs; a call is executed or rejected.", 12, signals),
]
