"""Kernels that process robots or targets side by side compute the same as the GPU form, one per thread."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lissajous_env

PACKAGE = Path(lissajous_env.__file__).parent

PLAYED = """
import sys

import numpy as np

import lissajous_env

kept = {}
for name, worlds, settings in (("rough", 3, {}), ("experiment", 7, {"task.boundary": "wall"})):
    simulation = lissajous_env.Simulation(lissajous_env.scenario(name, **settings), worlds, seed=3, threads=1)
    rng = np.random.default_rng(0)
    for _ in range(60):
        simulation.step(rng.uniform(-1, 1, simulation.action_shape).astype(np.float32))
    kept |= {f"{name} {key}": value for key, value in simulation.save_state().items()}
np.savez(sys.argv[1], **kept)
print(lissajous_env.__file__)
"""


def played(path, folder):
    """Return the results of the package in a folder, by name; the process prints the path of the package."""
    environment = os.environ | {"PYTHONPATH": str(path)}
    command = [sys.executable, "-c", PLAYED, str(folder / "kept.npz")]
    output = subprocess.run(command, check=True, cwd=folder, env=environment, capture_output=True, text=True).stdout
    assert Path(output.strip().splitlines()[-1]).is_relative_to(path)
    with np.load(folder / "kept.npz") as archive:
        return dict(archive)


@pytest.mark.long
def test_one_by_one_they_do_the_same_to_the_last_bit(tmp_path):
    # Oracle: a copy of the package whose kernels take one robot or target at a time, as they do on a GPU. Worlds of
    # five robots fill no block of sixteen, so blocks hold parts of worlds, and the last one is not full.
    copy, folder = tmp_path / "copy", tmp_path / "empty"
    folder.mkdir()
    shutil.copytree(PACKAGE, copy / "lissajous_env", ignore=shutil.ignore_patterns("__pycache__"))
    changed = copy / "lissajous_env" / "device" / "abreast.py"
    of_kernels, of_host = (text := changed.read_text()).count("return {_LENGTH};"), text.count("return _LENGTH if")
    assert (of_kernels, of_host) == (1, 1)
    changed.write_text(text.replace("return {_LENGTH};", "return 1;").replace("return _LENGTH if", "return 1 if"))
    alone, together = played(copy, folder), played(PACKAGE.parent, folder)
    assert alone.keys() == together.keys()
    assert [name for name in alone if not np.array_equal(alone[name], together[name], equal_nan=True)] == []
