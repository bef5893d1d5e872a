"""Ids under which Gymnasium and PettingZoo make the environments of a scenario, or of a space of scenarios."""

import gymnasium
import pettingzoo


def register_ids(name: str, is_space: bool = False) -> None:
    """Register `lissajous/NAME-v0` with Gymnasium and PettingZoo; environments look up the scenario when made.

    Batches of a space of scenarios are made by Gymnasium itself.
    """
    of_ours, settings, making = f"lissajous/{name}-v0", {"scenario": name}, "lissajous_env.envs.making"
    vector = None if is_space else "lissajous_env.envs.gymnasium_vector:LissajousVectorEnv"
    gymnasium.register(of_ours, f"{making}:gymnasium_env", kwargs=settings, vector_entry_point=vector)
    pettingzoo.register("parallel", of_ours, f"{making}:parallel_env", kwargs=settings)
    pettingzoo.register("aec", of_ours, f"{making}:env", kwargs=settings)
