"""Kernels that process robots or targets side by side compute the same as the GPU form, one per thread."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import lissajous_env
from lissajous_env.device import abreast
from lissajous_env.device.devices import as_device, compile_quietly

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
    told = subprocess.run(command, check=True, cwd=folder, env=environment, capture_output=True, text=True).stdout
    assert Path(told.strip().splitlines()[-1]).is_relative_to(path)
    with np.load(folder / "kept.npz") as kept:
        return dict(kept)


@pytest.mark.long
def test_one_by_one_they_do_the_same_to_the_last_bit(tmp_path):
    # Oracle: a copy of the package whose kernels take one robot or target at a time, as they do on a GPU. Worlds of
    # five robots fill no block of sixteen, so blocks hold parts of worlds, and the last one is not full.
    copy, folder = tmp_path / "copy", tmp_path / "empty"
    folder.mkdir()
    shutil.copytree(PACKAGE, copy / "lissajous_env", ignore=shutil.ignore_patterns("__pycache__"))
    changed = copy / "lissajous_env" / "device" / "abreast.py"
    text = changed.read_text()
    assert text.count("_ON_CPU = int(ABREAST)") == 1
    changed.write_text(text.replace("_ON_CPU = int(ABREAST)", "_ON_CPU = 1"))
    alone, together = played(copy, folder), played(PACKAGE.parent, folder)
    assert alone.keys() == together.keys()
    assert [name for name in alone if not np.array_equal(alone[name], together[name], equal_nan=True)] == []


@wp.kernel
def pass_on(
    begin: int,
    end: int,
    active: wp.array(dtype=int),
    step: wp.array(dtype=int),
    numbers: wp.array2d(dtype=float),
    phases: wp.array2d(dtype=wp.float64),
    status: wp.array2d(dtype=int),
    vectors: wp.array2d(dtype=wp.vec3),
    rows: wp.array3d(dtype=float),
    numbers_out: wp.array2d(dtype=float),
    phases_out: wp.array2d(dtype=wp.float64),
    bits_out: wp.array2d(dtype=int),
    vectors_out: wp.array2d(dtype=wp.vec3),
    pairs_out: wp.array2d(dtype=wp.vec2),
    fours_out: wp.array2d(dtype=wp.vec4),
    rows_out: wp.array3d(dtype=float),
    places_out: wp.array3d(dtype=wp.vec3),
):
    """Load of each kind what there is, and store it elsewhere."""
    n = status.shape[1]
    block = abreast.block_of(wp.tid(), begin, end, n, active)
    if block.count == 0:
        return
    x = abreast.coordinates(block, vectors, 0)
    y = abreast.coordinates(block, vectors, 1)
    z = abreast.coordinates(block, vectors, 2)
    number = abreast.floats(block, numbers)
    row = abreast.entries(block, rows, 3)
    working = block.active_mask & abreast.where_equal(block, status, 7)
    late = abreast.where_world(block, n, step, 5) | abreast.where_above(block, number, 0.5)
    abreast.put_floats(block, working, number, numbers_out)
    abreast.put_doubles(block, block.active_mask, abreast.doubles(block, phases), phases_out)
    abreast.put_bits(block, block.active_mask, late, bits_out)
    abreast.put_vectors(block, block.active_mask, x, y, z, vectors_out)
    abreast.put_pairs(block, working, x, z, pairs_out)
    abreast.put_fours(block, working, x, y, z, row, fours_out)
    abreast.put_entries(block, block.active_mask, row, 1, rows_out)
    abreast.put_places(block, working, x, y, 2, places_out)


@pytest.mark.parametrize(("n", "begin", "end"), [(1, 0, 40), (5, 0, 200), (5, 33, 150), (16, 16, 640), (50, 7, 1999)])
def test_a_block_loads_and_stores_its_own_robots_alone(n, begin, end):
    # Oracle: NumPy, for 40 worlds of which some take no part.
    device, rng = as_device("cpu"), np.random.default_rng(n + begin)
    active, step = rng.integers(0, 2, 40), rng.integers(0, 10, 40)
    status, numbers, phases = rng.choice([6, 7], (40, n)), rng.uniform(size=(40, n)), rng.uniform(size=(40, n))
    vectors, rows = rng.uniform(size=(40, n, 3)).astype(np.float32), rng.uniform(size=(40, n, 4)).astype(np.float32)
    numbers = numbers.astype(np.float32)
    given = [(active, int), (step, int), (numbers, float), (phases, wp.float64), (status, int), (vectors, wp.vec3)]
    taken = [wp.array(values, dtype=dtype, device=device) for values, dtype in [*given, (rows, float)]]
    kinds = (float, wp.float64, int, wp.vec3, wp.vec2, wp.vec4)
    outputs = [wp.full((40, n), -1, dtype=kind, device=device) for kind in kinds]
    outputs += [wp.full((40, n, 4), -1, dtype=kind, device=device) for kind in (float, wp.vec3)]
    with compile_quietly():
        blocks = -(-(end - begin) // abreast.width_on(device))
        wp.launch(pass_on, blocks, [begin, end, *taken], outputs=outputs, device=device)

    index = np.arange(40 * n).reshape(40, n)
    taking = (index >= begin) & (index < end) & (active == 1)[:, None]
    working = taking & (status == 7)
    x, y, z = np.moveaxis(vectors, -1, 0)
    whole, entered, placed = np.full((40, n), -1.0), np.full((40, n, 4), -1.0), np.full((40, n, 4, 3), -1.0)
    entered[taking, 1] = rows[taking, 3]
    placed[working, 2] = np.stack([x, y, 0 * x], axis=-1)[working]
    expected = [
        np.where(working, numbers, whole),
        np.where(taking, phases, whole),
        np.where(taking, (step >= 5)[:, None] | (numbers > 0.5), whole),
        np.where(taking[..., None], vectors, -1),
        np.where(working[..., None], np.stack([x, z], axis=-1), -1),
        np.where(working[..., None], np.stack([x, y, z, rows[..., 3]], axis=-1), -1),
        entered,
        placed,
    ]
    for got, wanted in zip(outputs, expected, strict=True):
        np.testing.assert_array_equal(got.numpy(), wanted)
