"""Warp for the type checker, which cannot follow it: in a kernel, names of types are calls and numbers are 32 bits."""

from typing import Any

def __getattr__(name: str) -> Any: ...
