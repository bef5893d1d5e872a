"""TorchRL and BenchMARL: the batch of worlds as an environment and as tasks, and their modules as policies."""

from training.torchrl.env import LissajousTorchEnv
from training.torchrl.model_policy import ModelPolicy

__all__ = ["LissajousTorchEnv", "ModelPolicy"]
