"""TorchRL and BenchMARL: the environment, tasks, and modules as policies."""

from lissajous_env.plugins import missing

try:
    from training.torchrl.env import LissajousTorchEnv
    from training.torchrl.module_policy import ModulePolicy
except ImportError as error:
    raise missing("training.torchrl", "marl", error) from error

__all__ = ["LissajousTorchEnv", "ModulePolicy"]
