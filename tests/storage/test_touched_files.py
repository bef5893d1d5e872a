"""Number of files that one more scenario, policy, stage, ... changes, tried in a copy of the package."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("lissajous_env", "baselines", "training")

POLICY = """
import numpy as np
from baselines.policies.base import Policy
from baselines.policies.registry import register


@register("half", kind="curve")
class Half(Policy):
    def decide(self, observation):
        return np.full((*self.shape, 1), 0.5)
"""

STAGE = """
from lissajous_env.device.stage import ROBOT, stage
from lissajous_env.world.state import Clock, Robots


@stage(ROBOT, writes="robots: speed")
def halve_speeds(w: int, i: int, clock: Clock, robots: Robots):
    \"\"\"Halve the speed of each robot.\"\"\"
    robots.speed[w, i] = 0.5 * robots.speed[w, i]
"""


def evaluated(policy):
    return f"""
made = lissajous_env.scenario("failure", **{{"task.duration": 1.0}})
assert len(lissajous_env.evaluate(baselines.make("{policy}", made, 2), made, seeds=range(2))) == 2
"""


CASES = {
    "policy": ({"baselines/policies/half.py": POLICY}, {}, evaluated("half")),
    "scenario": (
        {},
        {"lissajous_env/parameters/shipped.toml": [("[ideal]", "[mine]")]},
        'assert lissajous_env.parallel_env("mine").reset(seed=1)',
    ),
    "stage": (
        {"lissajous_env/world/robots/halving.py": STAGE},
        {
            "lissajous_env/world/stages.py": [
                (
                    '        Stage("end", end_episodes, when=moves),',
                    '        Stage("end", end_episodes, when=moves),\n        Stage("halving", halve_speeds),',
                ),
                (
                    "from lissajous_env.world.robots.faults",
                    "from lissajous_env.world.robots.halving import halve_speeds\n"
                    "from lissajous_env.world.robots.faults",
                ),
            ]
        },
        """
simulation = lissajous_env.Simulation("failure")
simulation.advance()
assert "halving" in str(simulation.stages)
""",
    ),
}
"""New files, lines changed in others, and a program that uses the new thing, by what is added."""


def test_files_to_touch(tmp_path):
    # Oracle: two for what the kernels of the world are a part of, one for each of the others.
    for package in PACKAGES:
        # With the times of the files, so that what Python compiled of unchanged ones is good for the copy as well.
        shutil.copytree(ROOT / package, tmp_path / package)
    for name in CASES:
        files, lines, _ = CASES[name]
        assert len(files) + len(lines) <= (2 if "world" in "".join([*files, *lines]) else 1)
        for path, text in files.items():
            (tmp_path / path).write_text(text)
        for path, changes in lines.items():
            text = (tmp_path / path).read_text()
            for old, new in changes:
                assert text.count(old) == 1, old
                text = text.replace(old, new)
            (tmp_path / path).write_text(text)
    program = f"import lissajous_env, baselines\nassert {str(tmp_path)!r} in baselines.__file__\n"
    program += "".join(CASES[name][2] + "\n" for name in CASES)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", program]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert ended.returncode == 0, ended.stderr
