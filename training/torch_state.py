"""The states of trainings with PyTorch as plain arrays."""

from typing import Any

import numpy as np
import torch
from torch import nn

from training.learned.checkpoint import prefixed, within


def save_state(module: nn.Module, optimizer: torch.optim.Optimizer) -> dict[str, np.ndarray]:
    """Copy a module, its optimizer, and the state of torch's and NumPy's random generators, by name."""
    arrays = prefixed("model", {name: tensor.detach().cpu().numpy() for name, tensor in module.state_dict().items()})
    for k, moments in optimizer.state_dict()["state"].items():
        arrays |= prefixed(f"optimizer.{k}", {name: tensor.cpu().numpy() for name, tensor in moments.items()})
    _, keys, position, *_ = np.random.get_state()
    arrays |= {"random": torch.get_rng_state().numpy(), "shuffle": np.append(keys, np.uint32(position))}
    return {name: np.array(array) for name, array in arrays.items()}


def load_state(module: nn.Module, optimizer: torch.optim.Optimizer, arrays: dict[str, np.ndarray]) -> None:
    """Resume from what `save_state` returned; other names are ignored."""
    module.load_state_dict({name: torch.from_numpy(array) for name, array in within("model", arrays).items()})
    state: dict[str, Any] = optimizer.state_dict()
    for name, array in within("optimizer", arrays).items():
        k, moment = name.split(".")
        state["state"].setdefault(int(k), {})[moment] = torch.from_numpy(array)
    optimizer.load_state_dict(state)
    torch.set_rng_state(torch.from_numpy(arrays["random"]))
    np.random.set_state(("MT19937", arrays["shuffle"][:-1], int(arrays["shuffle"][-1]), 0, 0.0))
