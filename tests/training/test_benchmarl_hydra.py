"""BenchMARL's Hydra command on the scenarios."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import lissajous_env

pytest.importorskip("benchmarl")

ROOT = Path(__file__).resolve().parents[2]
SHORT = (
    "experiment.max_n_iters=1", "experiment.on_policy_collected_frames_per_batch=60",
    "experiment.on_policy_n_envs_per_worker=2", "experiment.on_policy_minibatch_size=30",
    "experiment.on_policy_n_minibatch_iters=1", "experiment.evaluation=false", "experiment.loggers=[]",
    "experiment.create_json=false",
)  # fmt: skip


def test_a_task_trains_by_its_name_with_fields_of_the_scenario_changed(tmp_path):
    # Oracle: 60 frames of two worlds are 30 steps, the whole of an episode of 3 s: its return is known then.
    command = [sys.executable, "-m", "training.torchrl.hydra_run", "task=lissajous/failure", "algorithm=mappo", *SHORT]
    changed = ["+task.task.duration=3.0", "+task.targets.count=4"]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    done = subprocess.run([*command, *changed], cwd=tmp_path, env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert re.search(r"mean return = -?[\d.]+", done.stderr)


def test_every_scenario_is_a_task_of_hydra():
    from benchmarl.environments import task_config_registry
    from hydra.core.config_store import ConfigStore

    import training.torchrl.hydra_run  # noqa: F401 - registers them

    names = {name for name in task_config_registry if name.startswith("lissajous/")}
    assert names == {f"lissajous/{name}" for name in lissajous_env.scenarios()}
    assert set(ConfigStore.instance().list("task/lissajous")) == {f"{name}.yaml" for name in lissajous_env.scenarios()}
