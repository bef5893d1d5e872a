"""Formulas over the fields of a scenario, such as `"2 * curve.half_height"`, and literals, evaluated without `eval`."""

import ast
import math
import operator
from collections.abc import Callable
from typing import Any

from lissajous_env.wording import shown

_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_FUNCTIONS = {"round": round, "min": min, "max": max, "sqrt": math.sqrt}


class Formula:
    """An expression of numbers, names, `+ - * /`, comparisons, `round`, `min`, `max`, `sqrt`, or another literal.

    Literals are text, True, False, None, and tuples, lists and dictionaries of expressions.

    Args:
        text: The expression. Names may be dotted, as in `robot.radius / sensing_radius`.

    Raises:
        ValueError: the text is no such expression.
    """

    def __init__(self, text: str):
        self.text = text
        try:
            self._compute = _compiled(ast.parse(text.strip(), mode="eval").body)
        except (ValueError, AttributeError, SyntaxError, RecursionError, MemoryError):
            rule = "formula must be an expression of numbers, names, + - * /, comparisons, round, min, max and sqrt"
            raise ValueError(f"{rule}, got {shown(text)}") from None

    def __call__(self, look_up: Callable[[str], Any]) -> Any:
        """Return the value, with `look_up` returning that of each name.

        Raises:
            ValueError: a name is unknown, or the value is not defined, such as 1 / 0; the message names the formula.
        """
        try:
            return self._compute(look_up)
        except (ValueError, TypeError, ArithmeticError) as error:
            raise ValueError(f"formula {self.text!r} must have a value, got {error}") from error

    def __repr__(self) -> str:
        return f"Formula({self.text!r})"


def _compiled(node: ast.expr) -> Callable[[Callable[[str], Any]], Any]:
    """Return the function that evaluates a node; raise ValueError for one that formulas do not have."""
    if isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float, str, type(None))):
        value = node.value
        return lambda look_up: value
    if name := _dotted(node):
        return lambda look_up: look_up(name)
    if isinstance(node, ast.Tuple):
        return _applied(lambda *values: values, node.elts)
    if isinstance(node, ast.List):
        return _applied(lambda *values: list(values), node.elts)
    if isinstance(node, ast.Dict):
        keys, values = ast.Tuple([key for key in node.keys if key]), ast.Tuple(node.values)
        return _applied(lambda names, entries: dict(zip(names, entries, strict=True)), [keys, values])
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _applied(_OPERATORS[type(node.op)], [node.left, node.right])
    if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
        return _applied(_OPERATORS[type(node.op)], [node.operand])
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _OPERATORS:
        return _applied(_OPERATORS[type(node.ops[0])], [node.left, *node.comparators])
    match node:
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _FUNCTIONS:
            return _applied(_FUNCTIONS[name], arguments)
    raise ValueError("no formula")


def _applied(function: Callable[..., Any], nodes: list[ast.expr]) -> Callable[[Callable[[str], Any]], Any]:
    parts = [_compiled(node) for node in nodes]
    return lambda look_up: function(*(part(look_up) for part in parts))


def _dotted(node: ast.expr) -> str:
    """Return a dotted name, or "" for another expression."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute) and (before := _dotted(node.value)):
        return f"{before}.{node.attr}"
    return ""
