"""Picture of a scenario: a moment of an episode, as the environments render it."""

import io

from PIL import Image

import baselines
import lissajous_env
from docs.generator.replays import policy_for
from lissajous_env.parameters.scenario import Scenario

_MOMENT = 8.0
"""Latest time of the picture [s], at which some targets have appeared."""
MOST_TARGETS = 3000
"""Largest number of targets drawn; more would cover the picture."""


def picture_of(scenario: Scenario) -> bytes:
    """Draw a moment of seed 1 as a PNG."""
    fewer = {"targets.count": min(scenario.targets.count, MOST_TARGETS)}
    env = lissajous_env.parallel_env(scenario, render_mode="rgb_array", **fewer)
    policy = baselines.make(policy_for(scenario), env.scenario)
    observations, _ = env.reset(seed=1)
    for _ in range(min(round(_MOMENT / env.scenario.task.step), env.scenario.task.steps - 1)):
        observations, *_ = env.step(policy.act(observations))
    image = Image.fromarray(env.render())
    env.close()
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
