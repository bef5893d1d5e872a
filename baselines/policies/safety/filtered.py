"""A policy whose actions pass through a filter."""

from typing import Any

import warp as wp

from baselines.policies.base import Filter, Policy


class Filtered(Policy):
    """A policy whose actions pass through a filter: the filter decides last.

    Args:
        policy: The policy.
        filter: Class of the filter, such as `baselines.policies.safety.proved.Proved`.
        parameters: Parameters of the filter; by default those that it has for the scenario.

    Raises:
        ValueError: the filter is for robots of another kind.
    """

    arrays = "warp"

    def __init__(self, policy: Policy, filter: type[Filter], parameters: Any = None):
        self.stays_inside = not filter.stays_inside
        super().__init__(policy.scenario, policy.num_worlds, policy.device)
        given = {} if parameters is None else {"parameters": parameters}
        self.policy = policy
        self.filter = filter(self.scenario, self.num_worlds, self.device, **given)
        self.kind, self.communicates = filter.kind, filter.communicates
        self.name = policy.name + filter.suffix

    def decide(self, observation: wp.array) -> None:
        """Let the policy act, and filter its actions."""
        self.filter(observation, self.policy.act(observation), self.action)
