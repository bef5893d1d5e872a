"""State of a training with RLlib as plain arrays, for checkpoints without RLlib's pickles."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.core import ALL_MODULES
from ray.rllib.utils.metrics import (
    ENV_RUNNER_RESULTS,
    LEARNER_RESULTS,
    NUM_ENV_STEPS_SAMPLED_LIFETIME,
    NUM_MODULE_STEPS_TRAINED_LIFETIME,
)
from ray.rllib.utils.metrics.metrics_logger import MetricsLogger

from training.rllib.ppo import MODULE

_COUNTERS = {
    "steps_sampled": (ENV_RUNNER_RESULTS, NUM_ENV_STEPS_SAMPLED_LIFETIME),
    "rows_trained": (LEARNER_RESULTS, ALL_MODULES, NUM_MODULE_STEPS_TRAINED_LIFETIME),
}
"""RLlib's lifetime counters; the learning rate depends on the first."""
_OPTIMIZER = f"{MODULE}_default_optimizer"
"""RLlib's name of the module's optimizer."""
_MOMENTS = ("step", "exp_avg", "exp_avg_sq")
"""State of Adam per parameter."""


def steps_sampled(algorithm: Algorithm) -> int:
    """Return the number of environment steps that an algorithm has collected."""
    return _count(algorithm, "steps_sampled")


def save_ppo(algorithm: Algorithm) -> dict[str, np.ndarray]:
    """Copy what a resumed training needs: module, Adam's moments, learning rate and counters."""
    module, optimizer = _learner_state(algorithm)
    arrays = {f"model.{name}": np.array(array) for name, array in module.items()}
    for k, (name, array) in enumerate(module.items()):
        # Before the first update there are no moments, which is equivalent to zeros.
        kept = optimizer["state"].get(k, {})
        for moment in _MOMENTS:
            values = np.broadcast_to(kept.get(moment, 0.0), _shape(moment, array))
            arrays[f"optimizer.{name}.{moment}"] = values.astype(np.float32)
    arrays["learning_rate"] = np.array([optimizer["param_groups"][0]["lr"]])
    return arrays | {f"counter.{name}": np.array([_count(algorithm, name)]) for name in _COUNTERS}


def load_ppo(algorithm: Algorithm, arrays: Mapping[str, np.ndarray], updates: int) -> None:
    """Restore the saved state in a new algorithm with the same settings, and in its workers.

    Args:
        algorithm: New algorithm.
        arrays: Result of `save_ppo`.
        updates: Number of completed iterations.

    Raises:
        ValueError: an array is missing, has another shape or is not finite.
    """
    module, optimizer = _learner_state(algorithm)
    shapes: dict[str, tuple[int, ...]] = {"learning_rate": (1,)} | {f"counter.{name}": (1,) for name in _COUNTERS}
    for name, array in module.items():
        shapes[f"model.{name}"] = array.shape
        shapes |= {f"optimizer.{name}.{moment}": _shape(moment, array) for moment in _MOMENTS}
    for name, shape in shapes.items():
        if name not in arrays:
            raise ValueError(f"state must contain {name}, but it is missing")
        if arrays[name].dtype.kind not in "fi" or arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
            raise ValueError(f"state's {name} must be finite and of shape {shape}, got shape {arrays[name].shape}")
    for k, name in enumerate(module):
        kept = {moment: arrays[f"optimizer.{name}.{moment}"] for moment in _MOMENTS}
        optimizer["state"][k] = kept | {"step": kept["step"].reshape(())}
    optimizer["param_groups"][0]["lr"] = float(arrays["learning_rate"][0])
    weights = {"rl_module": {MODULE: {name: arrays[f"model.{name}"] for name in module}}}
    learner = weights | {"optimizer": {_OPTIMIZER: {"module_id": MODULE, "state": optimizer}}}
    algorithm.set_state({"learner_group": {"learner": learner}, "training_iteration": updates})
    # `set_state` drops messages to a busy worker; this call waits instead.
    workers = algorithm.env_runner_group
    assert workers is not None
    workers.foreach_env_runner("set_state", kwargs={"state": weights}, local_env_runner=False)
    for name, (source, *key) in _COUNTERS.items():
        # Logged as by a worker or the learner, because later counts of these could not be added to own values.
        counted = MetricsLogger()
        counted.log_value(tuple(key), int(arrays[f"counter.{name}"][0]), reduce="lifetime_sum", with_throughput=True)
        algorithm.metrics.aggregate([counted.reduce()], key=source)


def _learner_state(algorithm: Algorithm) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the module's arrays by name, in the optimizer's order, and the optimizer's `state_dict`."""
    group = algorithm.learner_group
    assert group is not None
    learner = group.get_state()["learner"]
    return learner["rl_module"][MODULE], learner["optimizer"][_OPTIMIZER]["state"]


def _shape(moment: str, array: np.ndarray) -> tuple[int, ...]:
    return (1,) if moment == "step" else array.shape


def _count(algorithm: Algorithm, name: str) -> int:
    return int(algorithm.metrics.peek(_COUNTERS[name], default=0))
