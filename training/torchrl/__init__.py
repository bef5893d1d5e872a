"""TorchRL and BenchMARL: environments, tasks, and modules as policies."""

from training.torchrl.env import LissajousTorchEnv
from training.torchrl.model_policy import ModelPolicy
from training.torchrl.sampled import SampledTorchEnv
from training.torchrl.two_sided import TwoSidedTorchEnv

__all__ = ["LissajousTorchEnv", "ModelPolicy", "SampledTorchEnv", "TwoSidedTorchEnv"]
