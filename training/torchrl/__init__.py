"""TorchRL and BenchMARL: the environment, tasks, and modules as policies."""

from training.torchrl.env import LissajousTorchEnv
from training.torchrl.module_policy import ModulePolicy

__all__ = ["LissajousTorchEnv", "ModulePolicy"]
