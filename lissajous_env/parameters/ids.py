"""Ids under which Gymnasium and PettingZoo make the environments of a scenario."""

import gymnasium
import pettingzoo


def register_ids(name: str) -> None:
    """Register `lissajous/NAME-v0` with Gymnasium and PettingZoo; environments look up the scenario when made."""
    of_ours, settings = f"lissajous/{name}-v0", {"scenario": name}
    gymnasium.register(
        id=of_ours,
        entry_point="lissajous_env.envs.making:gymnasium_env",
        vector_entry_point="lissajous_env.envs.gymnasium_vector:LissajousVectorEnv",
        kwargs=settings,
    )
    pettingzoo.register("parallel", of_ours, "lissajous_env.envs.making:parallel_env", kwargs=settings)
    pettingzoo.register("aec", of_ours, "lissajous_env.envs.making:env", kwargs=settings)
