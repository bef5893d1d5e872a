"""Ids under which Gymnasium and PettingZoo make the environments of a scenario, or of a space of scenarios."""

import gymnasium
import pettingzoo


def register_ids(name: str) -> None:
    """Register `lissajous/NAME-v0` with Gymnasium and PettingZoo; environments look up the scenario when made."""
    vector = "lissajous_env.envs.gymnasium_vector:LissajousVectorEnv"
    _register(name, vector_entry_point=vector)


def register_space_ids(name: str) -> None:
    """Register `lissajous/NAME-v0` for a space of scenarios, whose batches are made by Gymnasium itself."""
    _register(name)


def _register(name: str, **entry_points: str) -> None:
    of_ours, settings = f"lissajous/{name}-v0", {"scenario": name}
    making = "lissajous_env.envs.making:gymnasium_env"
    gymnasium.register(id=of_ours, entry_point=making, kwargs=settings, **entry_points)  # type: ignore[arg-type]
    pettingzoo.register("parallel", of_ours, "lissajous_env.envs.making:parallel_env", kwargs=settings)
    pettingzoo.register("aec", of_ours, "lissajous_env.envs.making:env", kwargs=settings)
