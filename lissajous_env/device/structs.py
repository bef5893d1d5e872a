"""Kernel-side structs, generated from the dataclasses so that each name is declared once."""

import dataclasses
import functools
import types
import typing
from collections.abc import Mapping
from typing import Any

import warp as wp

from lissajous_env.device.stage import TYPES
from lissajous_env.device.warp_abi import variables_of
from lissajous_env.settings import parts, task

_KERNEL_TYPE = {float: wp.float32, int: wp.int32, bool: wp.int32}


@functools.cache
def struct_of(dataclass: type) -> Any:
    """Make the `wp.struct` of the numbers (float, int, bool, each also `| None`) and choices of a dataclass."""
    fields = {name: _KERNEL_TYPE[kind] for name, kind in _kernel_fields(dataclass)}
    name = f"{dataclass.__name__}Struct"
    # A struct is identified by module and name, both of which must survive pickling and a second process.
    body = {"__annotations__": fields, "__module__": dataclass.__module__, "__qualname__": name}
    return wp.struct(type(name, (), body))


def to_struct(struct: Any, value: Any) -> Any:
    """Copy the numbers of a dataclass instance, and the codes of its choices, into the same fields of a new struct."""
    filled = struct()
    for name in [name for name, _ in _kernel_fields(type(value)) if name in variables_of(struct)]:
        given = getattr(value, name)
        setattr(filled, name, code_of(type(value), name, given) if isinstance(given, str) else given)
    return filled


def code_of(dataclass: type, name: str, option: str) -> int:
    """Return the number that represents an option of a choice in kernels: its index."""
    field = next(field for field in dataclasses.fields(dataclass) if field.name == name)
    return field.metadata["options"].index(option)


@functools.cache
def _kernel_fields(dataclass: type) -> list[tuple[str, type]]:
    hints = typing.get_type_hints(dataclass)
    kinds = []
    for field in dataclasses.fields(dataclass):
        hint = int if field.metadata.get("options") else hints[field.name]
        kinds.append((field.name, typing.get_args(hint)[0] if isinstance(hint, types.UnionType) else hint))
    return [(name, kind) for name, kind in kinds if kind in _KERNEL_TYPE]


def allocate(struct: Any, shapes: Mapping[str, tuple[int, ...]], default: tuple[int, ...], device: Any) -> Any:
    """Make a struct whose arrays are zero, with the shape given by name or else the default shape."""
    filled = struct()
    for name, array in variables_of(struct).items():
        setattr(filled, name, wp.zeros(shapes.get(name, default), dtype=array.type.dtype, device=device))
    return filled


FormationStruct = struct_of(parts.Formation)
RobotStruct = struct_of(parts.Robot)
SensingStruct = struct_of(task.Sensing)
TargetStruct = struct_of(task.Targets)
FaultsStruct = struct_of(parts.Faults)
NoiseStruct = struct_of(parts.Noise)
TaskStruct = struct_of(task.Task)
TYPES.update(formation=FormationStruct, robot=RobotStruct, sensing=SensingStruct, target=TargetStruct)
TYPES.update(faults=FaultsStruct, noise=NoiseStruct, task=TaskStruct)
