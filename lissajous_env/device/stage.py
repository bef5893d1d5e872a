"""Stages: a kernel made of a function of a world and one of its entities, and what it writes.

`@stage(over, writes)` makes the kernel of a stage. The first parameters of the decorated function say what a thread has
to do; the kernel has other parameters instead, which a `Program` fills in:

| parameters of the function | the function is called for                       |
|----------------------------|--------------------------------------------------|
| `w`                        | each world                                       |
| `w`, and the entity        | each entity of each world                        |
| `w`, `lane`, `lanes`       | each world; it goes over every `lanes`-th entity |
| `block`                    | each block of robots side by side                |

Worlds that are not active are left out, by the parameter `clock`, which is added where it is missing. A program matches
all other parameters by name, so a name has the same type in every stage, and in the functions that stages call
(`@part`): `TYPES` contains it, of a struct by `named_struct`, and only other parameters are annotated.
"""

import ast
import inspect
import linecache
import textwrap
from collections.abc import Callable
from typing import Any

import warp as wp

from lissajous_env.device.abreast import Block, block_of

WORLD, ROBOT, TARGET, ROW, FIELD_ROW, BIN, ARRAY = "world", "robot", "target", "row", "field row", "bin", "array"

LAUNCH = "first", "last", "lanes", "entities"
"""Parameters of every kernel: its worlds, from `first` to `last` - 1, its threads per world, and entities per world."""

_LANE = """
tid, lane = wp.tid()
w = first + tid
"""
_ACTIVE = """
if clock.active[w] == 0:
    return
"""
_BLOCK = """
block = block_of(wp.tid(), first * entities, last * entities, entities, clock.active)
if block.active_mask == 0:
    return
"""

TYPES: dict[str, Any] = {"block": Block}
"""Types that parameters of these names have in every stage; other modules add theirs."""
INITIAL: dict[str, float] = {}
"""Values of arrays at the beginning of an episode, by struct and field, as `robots.phase`; others are zero."""


def named_struct(name: str, **initial: float) -> Callable[[type], Any]:
    """Make a decorator of Warp structs whose instances are the parameters of this name in every stage.

    `initial` are values of its arrays at the beginning of an episode, by field; those of the other arrays are zero.
    """

    def make(cls: type) -> Any:
        INITIAL.update((f"{name}.{field}", value) for field, value in initial.items())
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
        TypeError: a parameter has no annotation and no type of its name.
    """
    types, parameters = TYPES | function.__annotations__, list(inspect.signature(function).parameters)
    if unknown := [name for name in parameters if name not in types]:
        raise TypeError(f"parameters of {function.__qualname__} must have a type, got none for {unknown[0]}")
    return {name: types[name] for name in (*parameters, "return") if name in types}


def stage(over: str, writes: str, idle: bool = False, module: Any = None) -> Callable[[Any], Any]:
    """Make the kernel of a stage of a function.

    Args:
        over: Its entities: WORLD, ROBOT, TARGET, ROW (of the grid), FIELD_ROW (of contamination), BIN or ARRAY (of the
            state).
        writes: All that it changes, arrays and structs with their fields, as in `robots: position, phase; command`;
            empty for a stage that changes the whole state.
        idle: True for a function that is called for worlds that are not active, too.
        module: Warp module of the kernel; by default that of the function.

    Returns:
        A decorator that returns a kernel with the attributes `over`, `writes` and `by_block`, True for blocks.

    Raises:
        TypeError: as of `_types_of`, or a function of an entity returns before its end.
    """

    def make(function: Any) -> Any:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        by_block = tree.args.args[0].arg == "block"
        _arrange(tree, over, idle)
        tree.decorator_list.clear()
        kernel = wp.kernel(_compiled(tree, function), module=module or wp.get_module(function.__module__))
        kernel.over, kernel.writes, kernel.by_block = over, _written(writes), by_block
        return kernel

    return make


def _written(writes: str) -> tuple[str, ...]:
    """Return the names of what is written, as `robots.phase` and `command`."""
    names = []
    for entry in filter(None, writes.split(";")):
        name, _, fields = entry.partition(":")
        names += [f"{name.strip()}.{field.strip()}" for field in fields.split(",")] if fields else [name.strip()]
    return tuple(names)


def _arrange(tree: ast.FunctionDef, over: str, idle: bool) -> None:
    """Turn the definition of a stage's function into that of its kernel."""
    arguments, about = tree.args.args, tree.body[:1] if ast.get_docstring(tree) else []
    names, body = [argument.arg for argument in arguments], tree.body[len(about) :]
    active = "" if idle else _ACTIVE
    if names[0] == "block":
        replaced, before = 1, _BLOCK
    elif names[1:3] == ["lane", "lanes"]:
        replaced, before = 3, _LANE + active
    elif over != WORLD:
        if any(isinstance(node, ast.Return) for node in ast.walk(tree)):
            raise TypeError(f"{tree.name} must not return, because that would leave out the entities after this one")
        replaced, before = 2, _LANE + active
        loop = ast.parse(f"for {names[1]} in range(lane, entities, lanes):\n    pass").body[0]
        assert isinstance(loop, ast.For)
        loop.body, body = body, [loop]
    else:
        replaced, before = 1, _LANE + active
    clock = [] if idle or "clock" in names else [ast.arg("clock")]
    tree.args.args = [*(ast.arg(name, ast.Name("int")) for name in LAUNCH), *arguments[replaced:], *clock]
    tree.body = [*about, *ast.parse(before).body, *body]


def _compiled(tree: ast.FunctionDef, function: Any) -> Any:
    """Compile the definition of a kernel with the names that its stage's function can see, and add its types."""
    # Warp reads the source of a function through `linecache`.
    file, source = f"<stage {function.__module__}.{function.__qualname__}>", ast.unparse(tree)
    linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file
    names = {"block_of": block_of, "wp": wp} | function.__globals__ | inspect.getclosurevars(function).nonlocals
    exec(compile(source, file, "exec"), names)
    kernel = names[function.__name__]
    kernel.__module__, kernel.__qualname__ = function.__module__, function.__qualname__
    kernel.__annotations__ = _types_of(kernel)
    return kernel
