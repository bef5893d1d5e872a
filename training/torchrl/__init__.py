"""TorchRL and BenchMARL: the batch of worlds as an environment and as tasks."""

from training.torchrl.env import LissajousTorchEnv

__all__ = ["LissajousTorchEnv"]
