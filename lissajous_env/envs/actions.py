"""Tables of discrete actions, and arrays of other libraries."""

from typing import Any

import numpy as np

from lissajous_env.device.devices import is_torch
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario


def action_table(scenario: str | Scenario) -> np.ndarray:
    """Return (K, action_size) the actions from which a discrete action selects.

    They are steering x throttle, phase rates, or rest and velocities in eight directions. With messages of k numbers,
    the table contains every motion with each of k + 1 messages: first zeros, then 1 in component 0 and zeros elsewhere,
    and so on.
    """
    scenario = named.build(scenario)
    moves = np.array(scenario.model.table, dtype=np.float32)
    words = np.eye(scenario.messages.size + 1, dtype=np.float32)[:, 1:]
    return np.hstack([np.tile(moves, (len(words), 1)), np.repeat(words, len(moves), axis=0)])


def rogue_table() -> np.ndarray:
    """Return (9, 2) the actions from which a rogue's discrete action selects: rest, and eight directions."""
    angles = np.arange(8) * (np.pi / 4)
    return np.vstack([np.zeros((1, 2)), np.stack([np.cos(angles), np.sin(angles)], axis=1)]).astype(np.float32)


def on_host(actions: Any) -> Any:
    """Return arrays of other libraries as NumPy arrays, also torch's on a GPU, with a gradient, or of bfloat16."""
    if isinstance(actions, (list, tuple)):
        return [on_host(action) for action in actions]
    if is_torch(actions) and hasattr(actions, "detach"):
        plain = actions.detach().cpu().resolve_neg()
        is_short = plain.is_floating_point() and plain.element_size() < 4  # NumPy does not have all of these types
        return (plain.float() if is_short else plain).numpy()
    return np.asarray(actions) if hasattr(actions, "__array__") else actions
