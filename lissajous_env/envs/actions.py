"""Actions of one world: spaces, the table of discrete actions, and checks."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np

from lissajous_env.device.devices import is_torch
from lissajous_env.parameters import named
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown

LARGE = 1e30
"""Sum of squares above which actions are checked one by one."""


def action_table(scenario: str | Scenario) -> np.ndarray:
    """Return (K, action_size) the actions from which a discrete action selects: steering x throttle, or phase rates.

    With messages of k numbers, the table contains every motion with each of k + 1 messages: first zeros, then 1 in
    component 0 and zeros elsewhere, and so on.
    """
    scenario = named.build(scenario)
    moves = np.array(model_of(scenario.robot.kind).table, dtype=np.float32)
    words = np.eye(scenario.messages.size + 1, dtype=np.float32)[:, 1:]
    return np.hstack([np.tile(moves, (len(words), 1)), np.repeat(words, len(moves), axis=0)])


def action_space(scenario: Scenario, discrete: bool, seed: int | None = None) -> gymnasium.Space:
    """Return the action space of one robot: `Box(-1, 1, (action_size,))`, or `Discrete` over the rows of the table."""
    if discrete:
        return gymnasium.spaces.Discrete(len(action_table(scenario)), seed=seed)
    return gymnasium.spaces.Box(-1.0, 1.0, (scenario.action_size,), np.float32, seed=seed)


def rogue_table() -> np.ndarray:
    """Return (9, 2) the actions from which a rogue's discrete action selects: rest, and eight directions."""
    angles = np.arange(8) * (np.pi / 4)
    return np.vstack([np.zeros((1, 2)), np.stack([np.cos(angles), np.sin(angles)], axis=1)]).astype(np.float32)


def rogue_action_space(discrete: bool = False) -> gymnasium.Space:
    """Return the action space of one rogue: `Box(-1, 1, (2,))`, or `Discrete` over the rows of `rogue_table`."""
    if discrete:
        return gymnasium.spaces.Discrete(len(rogue_table()))
    return gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)


def check_agents(actions: Any, live: Sequence[str]) -> None:
    """Raise ValueError unless actions are a mapping that names each live agent once."""
    if not isinstance(actions, Mapping):
        raise ValueError(f"actions must be a dict of agents and their actions, got {shown(actions)}")
    if len(actions) != len(live) or not all(agent in actions for agent in live):
        missing = [agent for agent in live if agent not in actions]
        unknown = [agent for agent in actions if agent not in live]
        raise ValueError(f"actions must name each live agent once: missing {missing}, unknown or not live {unknown}")


def on_host(actions: Any) -> Any:
    """Return arrays of other libraries as NumPy arrays, also torch's on a GPU, with a gradient, or of bfloat16."""
    if isinstance(actions, (list, tuple)):
        return [on_host(each) for each in actions]
    if is_torch(actions) and hasattr(actions, "detach"):
        plain = actions.detach().cpu().resolve_neg()
        is_short = plain.is_floating_point() and plain.element_size() < 4  # NumPy does not have all of these types
        return (plain.float() if is_short else plain).numpy()
    return np.asarray(actions) if hasattr(actions, "__array__") else actions


class ActionReader:
    """Writes the actions of one world into an array; errors name the agent.

    Args:
        size: Number of components of an action.
        table: (K, size) actions from which a discrete action selects; None for continuous actions.
    """

    def __init__(self, size: int, table: np.ndarray | None = None):
        self._table, self._shape = table, (size,)

    def read(self, agent: str, action: Any, row_out: np.ndarray) -> None:
        """Write one agent's action into its row.

        Raises:
            ValueError: a wrong shape, an index outside the table, or a number that is not finite.
        """
        action = on_host(action)
        if self._table is not None:
            index = action.item() if isinstance(action, np.ndarray) and action.size == 1 else action
            is_whole = isinstance(index, (int, np.integer)) and not isinstance(index, bool)
            if not is_whole or not 0 <= index < len(self._table):
                last = len(self._table) - 1
                raise ValueError(f"action of {agent} must be a whole number from 0 to {last}, got {shown(action)}")
            row_out[:] = self._table[index]
            return
        values = np.asarray(action)
        # Some libraries squeeze an action with one component to a number.
        fits = values.shape == self._shape or (values.shape == () and self._shape == (1,))
        if not fits or values.dtype.kind not in "fiu":
            raise ValueError(f"action of {agent} must be numbers of shape {self._shape}, got {shown(action)}")
        row_out[:] = values

    def check(self, agents: list[str], rows: np.ndarray) -> None:
        """Raise ValueError for rows that are not finite, and clip values beyond float32."""
        # The sum of squares is not finite if any number is not.
        if not np.vdot(rows, rows) < LARGE:
            for agent, row in zip(agents, rows, strict=True):
                if not np.isfinite(row).all():
                    raise ValueError(f"action of {agent} must be finite, got {row.tolist()}")
            np.clip(rows, -1.0, 1.0, out=rows)
