"""Base of the `VecEnv`s over a batch of worlds, in which several rows share a world."""

from typing import Any

from stable_baselines3.common.vec_env import VecEnv


class BatchVecEnv(VecEnv):
    """`VecEnv` whose rows have no attributes or methods of their own."""

    def close(self) -> None:
        """Do nothing: there is nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the batch, repeated for each requested row."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the whole batch; rows have no attributes of their own."""
        if indices is not None and len(list(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"{attr_name} must be set for all rows at once, got indices {indices!r}")
        setattr(self, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of the batch once; return its result, repeated for each requested row."""
        result = getattr(self, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each row: rows are not wrapped."""
        return [False for _ in self._get_indices(indices)]
