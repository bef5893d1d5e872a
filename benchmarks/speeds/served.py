"""One large world of some version of this project, in a process of its own that measures times on request.

The process always runs this file, and imports only `lissajous_env` from the checkout that is measured.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

CURVES = {5: (3, 2), 101: (51, 50), 501: (251, 250), 1001: (501, 500)}
"""(a, b) of the curve by the number of robots."""


def peak_memory() -> float:
    """Return the largest memory of this process so far [MB]."""
    # `ru_maxrss` would include the memory of the parent process.
    fields = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(fields["VmHWM"].split()[0]) / 1024


def serve(robots: int, targets: int) -> None:
    """Make a world, print the path of its code, and run the number of steps in each line of standard input.

    After each line, print the processor time of a step [s]. An empty line ends the process, which then prints its
    largest memory [MB].
    """
    import numpy as np

    import lissajous_env

    a, b = CURVES[robots]
    overrides = {"curve.a": a, "curve.b": b, "targets.count": targets, "robot.radius": 0.001, "task.duration": 1e5}
    # Robots as fast as those of the included scenario; targets that are detected stay, so that a step keeps its cost.
    overrides |= {"formation.phase_rate": 1.02 / a, "targets.leave": False}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("swarm", **overrides), threads=1)
    scenario = simulation.scenario
    rate = scenario.formation.phase_rate / scenario.formation.alpha / scenario.robot.phase_rate_max
    action = np.full(simulation.action_shape, rate, dtype=np.float32)
    for _ in range(3):
        simulation.step(action)
    print(Path(lissajous_env.__file__).parent.parent, flush=True)
    for line in sys.stdin:
        if not line.strip():
            break
        begin = time.process_time()
        for _ in range(int(line)):
            simulation.step(action)
        print((time.process_time() - begin) / int(line), flush=True)
    print(peak_memory(), flush=True)


class Side:
    """A world of the version in a folder."""

    def __init__(self, folder: Path, robots: int, targets: int):
        # With -P, the current folder is not on the path, so only the named and the installed packages are imported.
        command = [sys.executable, "-P", "-m", "speeds.served", str(robots), str(targets)]
        path = os.pathsep.join(map(str, (folder, Path(__file__).resolve().parent.parent)))
        self._process = subprocess.Popen(
            command, env=os.environ | {"PYTHONPATH": path}, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        code_folder = Path(self._answer().strip())
        if code_folder.resolve() != folder.resolve():
            raise RuntimeError(f"what is measured must be of {folder}, got {code_folder}")

    def seconds(self, steps: int) -> float:
        """Return the mean time of some steps."""
        return float(self._ask(str(steps)))

    def peak(self) -> float:
        """End the process, and return its largest memory [MB]."""
        peak = float(self._ask(""))
        self._process.wait()
        return peak

    def _ask(self, line: str) -> str:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            sys.exit(f"error: a process that measures ended with {self._process.wait()}")
        return line


if __name__ == "__main__":
    serve(*map(int, sys.argv[1:]))
