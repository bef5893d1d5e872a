"""Code of a notebook, a prompt or a script travels to other processes by value; they cannot import it."""

from typing import Any

import cloudpickle

PROMPT = "__main__", "__mp_main__"
"""Modules that are other ones in other processes."""


class ByValue:
    """Wrapper of a function or class that is itself again after unpickling, also where it cannot be imported.

    What modules define is only named. A process without these modules cannot unpickle it.
    """

    def __init__(self, value: Any):
        self.value = value

    def __reduce__(self) -> tuple:
        return cloudpickle.loads, (cloudpickle.dumps(self.value),)


def replaces(new: Any, old: Any) -> bool:
    """Return whether an object at a prompt, or in a notebook, is a new version of another: it has the same full name.

    A cell that is run again defines its functions and classes anew.
    """
    names = [(getattr(each, "__module__", None), getattr(each, "__qualname__", None)) for each in (new, old)]
    return names[0] == names[1] and names[0][0] in PROMPT and names[0][1] is not None
