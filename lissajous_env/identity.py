"""Provenance of results: the code of users, the command, the machine, and versions.

The files of its modules identify the code of a user, so that results of different code are never mixed. Code of this
distribution is identified by its version, which results store beside these parts.
"""

import contextlib
import functools
import hashlib
import os
import platform
import re
import shlex
import sys
import types
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OWN_PACKAGES
from lissajous_env.device.devices import as_device, memory

MODULE = "module "
"""Prefix of the names of parts that are the file of a module."""


def fingerprint(value: Any) -> dict[str, str]:
    """Return what identifies a function, class, partial, Warp kernel or object, the same in every process, by name.

    Its parts are the name of the definition and a digest of the file of the module; in a script or at a prompt, of its
    own compiled code. A partial also has the parts of its arguments; of one that is no function, class, plain value or
    dataclass, only the type. Values in closures and attributes are not compared.
    """
    if isinstance(value, functools.partial):
        parts = fingerprint(value.func)
        for name, argument in (dict(enumerate(value.args)) | value.keywords).items():
            described = fingerprint(argument) if callable(argument) else {"": digest_of(_text_of(argument).encode())}
            for part, text in described.items():
                parts[part if part.startswith(MODULE) else f"argument {name} {part}".strip()] = text
        return parts
    if isinstance(value, types.MethodType):
        return fingerprint(value.__self__) | {"method": value.__name__}
    definition = value.func if isinstance(value, (wp.Kernel, wp.Function)) else value
    if not hasattr(definition, "__qualname__"):
        definition = type(definition)
    module = str(getattr(definition, "__module__", "builtins"))
    parts = {"code": f"{module}:{definition.__qualname__}"}
    return parts if module.partition(".")[0] in OWN_PACKAGES else parts | _source(definition, module)


def _source(definition: Any, module: str) -> dict[str, str]:
    """Return a digest of the file of a module; of a script or a prompt, of the compiled definition."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is not None and module != "__main__" and Path(file).is_file():
        return {MODULE + module: digest_of(Path(file).read_bytes())}
    parts = vars(definition) if isinstance(definition, type) else {"": definition}
    text = str([name + _text_of(part) for name, part in parts.items() if name[:2] != "__" or callable(part)])
    return {"source": digest_of(text.encode())}


def _text_of(part: Any) -> str:
    """Return the compiled code of a function, method or property, or the text of a value, without addresses."""
    part = getattr(part, "fget", getattr(part, "__func__", part))
    if isinstance(part, types.FunctionType):
        return _text_of(part.__code__) + _text_of((part.__defaults__, part.__kwdefaults__))
    if isinstance(part, types.CodeType):
        return f"{part.co_code.hex()} {part.co_names} {[*map(_text_of, part.co_consts)]}"
    part = sorted(map(repr, part)) if isinstance(part, (set, frozenset)) else part  # in an order of its own
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):  # all numbers and digits of arrays
        return re.sub(" at 0x[0-9a-fA-F]+", "", repr(part))


def digest_of(data: bytes) -> str:
    """Return a short digest of some bytes."""
    return hashlib.sha256(data).hexdigest()[:16]


def command() -> str:
    """Return the command line of this process."""
    return shlex.join(sys.argv)


def machine(device: str) -> dict[str, Any]:
    """Return a description of this machine and of a device, which may be one of other machines of a cluster."""
    gpu = ""
    with contextlib.suppress(ValueError):
        gpu = "" if as_device(device).is_cpu else f": {as_device(device).name}"
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "cpu": models[0] if models else platform.machine(),
        "cores": os.cpu_count(),
        "memory_gib": round(memory() / 2**30, 1),
        "os": platform.platform(),
        "device": device + gpu,
    }


def versions(*more: str) -> dict[str, str]:
    """Return the versions of Python and the packages on which the numbers depend, `more` packages included."""
    names = ("lissajous-env", "numpy", "warp-lang", "gymnasium", "pettingzoo", *more)
    return {"python": platform.python_version()} | {name: version(name) for name in names}


def provenance(device: str) -> dict[str, str]:
    """Return in words the command, machine and versions of numbers that are computed now."""
    here = machine(device)
    return {
        "command": command(),
        "machine": f"{here['cpu']}, {here['cores']} cores, {here['device']}",
        "versions": ", ".join(f"{name} {number}" for name, number in versions().items()),
    }
