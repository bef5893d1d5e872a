"""Stages: a kernel made of a function of a world and one of its entities, and what it writes.

`@stage(over, writes)` makes the kernel of a stage. The first parameters of the decorated function say what a thread has
to do; the kernel has the parameters of a layout instead, which a `Program` fills in:

| parameters of the function | layout   | the function is called for                       |
|----------------------------|----------|--------------------------------------------------|
| `w`                        | `WORLDS` | each world                                       |
| `w`, and the entity        | `LANES`  | each entity of each world                        |
| `w`, `lane`, `lanes`       | `LANES`  | each world; it goes over every `lanes`-th entity |
| `block`                    | `BLOCKS` | each block of robots side by side                |

Worlds that are not active are left out, by the parameter `clock`, which is added where it is missing. A program matches
all other parameters by name, so a name has the same type in every stage, and in the functions that stages call
(`@part`): `named` declares it once, and only other parameters are annotated. Those of `writes` are all that a stage
changes: a field of a struct as `targets.status`, or an array by its own name.

A struct with the default OPTIONAL may be missing from the values of a program. Such a program runs the kernel
`reduced`, in which the struct is empty, so that the compiler leaves out everything for which it would be read.
"""

import ast
import inspect
import linecache
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import warp as wp

from lissajous_env.device.abreast import Block, block_of
from lissajous_env.device.compilation import module_apart

WORLD, ROBOT, TARGET, ROW, FIELD_ROW, BIN, ARRAY = "world", "robot", "target", "row", "field row", "bin", "array"

WORLDS, LANES, BLOCKS = "worlds", "lanes", "blocks"

OPTIONAL: Any = object()
"""Default of a parameter that programs may lack."""

_WORLD = """
w = first + wp.tid()
"""
_LANE = """
tid, lane = wp.tid()
w = first + tid
"""
_ACTIVE = """
if clock.active[w] == 0:
    return
"""
_BLOCK = """
block = block_of(wp.tid(), begin, end, entities, clock.active)
if block.count == 0:
    return
"""

TYPES: dict[str, Any] = {"block": Block}
"""Types of parameters by their names."""


def named(**types: Any) -> None:
    """Declare the types that parameters of these names have in every stage."""
    TYPES.update(types)


def named_struct(name: str) -> Callable[[type], Any]:
    """Make a decorator of Warp structs whose instances are the parameters of this name in every stage."""

    def make(cls: type) -> Any:
        TYPES[name] = wp.struct(cls)
        return TYPES[name]

    return make


def part(function: Any) -> Any:
    """Make a Warp function for stages, whose parameters have the types of their names or their annotations."""
    function.__annotations__ = _types_of(function)
    return wp.func(function)


def _types_of(function: Any) -> dict[str, Any]:
    """Return the types of a function's parameters in their order, and of its result.

    Raises:
        TypeError: a parameter has no annotation and no type that `named` declares.
    """
    types, parameters = TYPES | function.__annotations__, list(inspect.signature(function).parameters)
    if unknown := [name for name in parameters if name not in types]:
        raise TypeError(f"parameters of {function.__qualname__} must have a type, got none for {unknown[0]}")
    result = {"return": types["return"]} if "return" in types else {}
    return {name: types[name] for name in parameters} | result


def stage(over: str, writes: str, idle: bool = False, module: Any = None) -> Callable[[Any], Any]:
    """Make the kernel of a stage of a function.

    Args:
        over: Its entities: WORLD, ROBOT, TARGET, ROW (of the grid), FIELD_ROW (of contamination), BIN or ARRAY (of the
            state).
        writes: What it changes: arrays, and structs with their fields, as in `robots: position, phase; command_out`;
            `robots: all` for all fields.
        idle: True for a function that is called for worlds that are not active, too.
        module: Warp module of the kernel; by default that of the function.

    Returns:
        A decorator that returns a kernel with the attributes `over`, `layout`, `writes`, `optional`, which are names,
        and, if there are any, `reduced`.

    Raises:
        TypeError: as of `_types_of`.
    """

    def make(function: Any) -> Any:
        parameters, home = inspect.signature(function).parameters, module or wp.get_module(function.__module__)
        optional = [name for name in parameters if parameters[name].default is OPTIONAL]
        # The whole kernel has a module of its own, because few scenarios need it.
        apart = module_apart(".".join([home.name, *optional]), home.options) if optional else home
        kernel = _kernel(function, over, writes, idle, apart, [])
        kernel.optional = optional
        if optional:
            kernel.reduced = _kernel(function, over, writes, idle, home, optional)
        return kernel

    return make


def _kernel(function: Any, over: str, writes: str, idle: bool, module: Any, empty: Sequence[str]) -> Any:
    """Make the kernel of a function in a module, in which some of its structs are empty."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    tree.args.args = [argument for argument in tree.args.args if argument.arg not in empty]
    layout = _arrange(tree, over, idle, "".join(f"{name} = {name}_struct()\n" for name in empty))
    tree.decorator_list.clear()
    tree.args.defaults.clear()
    kernel = wp.kernel(_compiled(tree, function), module=module)
    kernel.over, kernel.layout, kernel.optional = over, layout, []
    kernel.writes = tuple(name for name in _written(writes) if name.partition(".")[0] not in empty)
    return kernel


def _written(writes: str) -> tuple[str, ...]:
    """Return the names of what is written, as `robots.phase` and `command_out`."""
    names = []
    for part in filter(None, writes.split(";")):
        name, _, fields = part.partition(":")
        names += [f"{name.strip()}.{field.strip()}" for field in fields.split(",")] if fields else [name.strip()]
    return tuple(names)


def _arrange(tree: ast.FunctionDef, over: str, idle: bool, first: str) -> str:
    """Turn the definition of a stage's function into that of its kernel, with first statements; return its layout."""
    arguments, about = tree.args.args, tree.body[:1] if ast.get_docstring(tree) else []
    names, body = [argument.arg for argument in arguments], tree.body[len(about) :]
    if names[0] == "block":
        layout, places, given, before = BLOCKS, "begin: int, end: int, entities: int", 1, _BLOCK
    elif names[1:3] == ["lane", "lanes"]:
        layout, places, given, before = LANES, "first: int, lanes: int", 3, _LANE
    elif over != WORLD:
        layout, places, given, before = LANES, "first: int, lanes: int, entities: int", 2, _LANE
        loop = ast.parse(f"for {names[1]} in range(lane, entities, lanes):\n    pass").body[0]
        assert isinstance(loop, ast.For)
        loop.body, body = body, [loop]
    else:
        layout, places, given, before = WORLDS, "first: int", 1, _WORLD
    clock = [] if idle or "clock" in names else _parameters("clock")
    tree.args.args = [*_parameters(places), *arguments[given:], *clock]
    before += ("" if idle or names[0] == "block" else _ACTIVE) + first
    tree.body = [*about, *ast.parse(before).body, *body]
    return layout


def _parameters(text: str) -> list[ast.arg]:
    definition = ast.parse(f"def places({text}): pass").body[0]
    assert isinstance(definition, ast.FunctionDef)
    return definition.args.args


def _compiled(tree: ast.FunctionDef, function: Any) -> Any:
    """Compile the definition of a kernel with the names that its stage's function can see, and add its types."""
    # Warp reads the source of a function through `linecache`.
    file, source = f"<stage {function.__module__}.{function.__qualname__}>", ast.unparse(tree)
    linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file
    names = {"block_of": block_of, "wp": wp} | {f"{name}_struct": struct for name, struct in TYPES.items()}
    names |= function.__globals__ | inspect.getclosurevars(function).nonlocals
    exec(compile(source, file, "exec"), names)
    kernel = names[function.__name__]
    kernel.__module__, kernel.__qualname__ = function.__module__, function.__qualname__
    kernel.__annotations__ = _types_of(kernel)
    return kernel
