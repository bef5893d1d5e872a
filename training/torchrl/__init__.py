"""TorchRL and BenchMARL: the environment, tasks, and modules as policies."""

from training.torchrl.env import LissajousTorchEnv
from training.torchrl.model_policy import ModelPolicy

__all__ = ["LissajousTorchEnv", "ModelPolicy"]
