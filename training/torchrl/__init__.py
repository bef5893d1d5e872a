"""TorchRL and BenchMARL: the environment, tasks, and modules as policies."""

from lissajous_env.plugins import requiring

with requiring("training.torchrl", "marl"):
    from training.torchrl.env import LissajousTorchEnv
    from training.torchrl.module_policy import ModulePolicy

__all__ = ["LissajousTorchEnv", "ModulePolicy"]
