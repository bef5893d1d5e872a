"""Expressions over fields of a scenario, such as `"2 * curve.half_height"`, and literals, evaluated without `eval`."""

import ast
import math
import numbers
import operator
from collections.abc import Callable, Collection
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
Names = Callable[[str], Any]
"""Function that returns the value of a name."""


class Formula:
    """An expression of numbers, names, `+ - * /`, comparisons, `round`, `min`, `max`, `sqrt`, or another literal.

    Literals are text, True, False, None, and tuples, lists and dictionaries of expressions.

    Args:
        text: The expression. Names may be dotted, as in `robot.radius / sensing_radius`.
        functions: Names of further functions, which `names` returns.

    Raises:
        ValueError: the text is no such expression.
    """

    def __init__(self, text: str, functions: Collection[str] = ()):
        self.text, self._functions = text, functions
        self.called: list[str] = []
        """Names of the further functions that it calls, one for each call."""
        try:
            self._compute = self._compiled(ast.parse(text.strip(), mode="eval").body)
        except (ValueError, AttributeError, SyntaxError, RecursionError, MemoryError):
            known = ", ".join((*_FUNCTIONS, *functions))
            rule = f"formula must be an expression of numbers, names, + - * /, comparisons, {known}"
            raise ValueError(f"{rule}, got {shown(text)}") from None

    def __call__(self, names: Names) -> Any:
        """Return the value, with `names` returning that of each name.

        Raises:
            ValueError: a name is unknown, or the value is not defined, such as 1 / 0; the message names the formula.
        """
        try:
            return self._compute(names)
        except (ValueError, TypeError, ArithmeticError, LookupError) as error:
            raise ValueError(f"formula {self.text!r} must have a value, got {error}") from error

    def _compiled(self, node: ast.expr | None) -> Callable[[Names], Any]:
        """Return the function that evaluates a node; raise ValueError for one that formulas do not have."""
        match node:
            case ast.Constant(value=bool() | int() | float() | str() | None):
                return lambda names: node.value
            case ast.Name() | ast.Attribute():
                name = _dotted(node)
                return lambda names: names(name)
            case ast.Tuple(elts=entries):
                return self._applied(lambda *values: values, *entries)
            case ast.List(elts=entries):
                return self._applied(lambda *values: list(values), *entries)
            case ast.Dict(keys=keys, values=entries):
                pairs = [self._applied(lambda *pair: pair, *pair) for pair in zip(keys, entries, strict=True)]
                return lambda names: dict(pair(names) for pair in pairs)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return self._applied(lambda *values: _OPERATORS[type(op)](*map(_number, values)), left, right)
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _OPERATORS:
                return self._applied(_OPERATORS[type(op)], left, right)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
                return self._applied(_OPERATORS[type(op)], operand)
            case ast.Call(func=ast.Name(id=name), args=entries, keywords=[]) if name in _FUNCTIONS:
                return self._applied(_FUNCTIONS[name], *entries)
            case ast.Call(func=ast.Name(id=name), args=entries, keywords=[]) if name in self._functions:
                self.called.append(name)
                return self._applied(lambda function, *values: function(*values), ast.Name(name), *entries)
        raise ValueError("no formula")

    def _applied(self, function: Callable[..., Any], *nodes: ast.expr | None) -> Callable[[Names], Any]:
        parts = [self._compiled(node) for node in nodes]
        return lambda names: function(*(part(names) for part in parts))


def _number(value: Any) -> Any:
    """Return a number; raise TypeError for another value, such as text, of which products can exhaust the memory."""
    if not isinstance(value, numbers.Real):
        raise TypeError(f"{shown(value)}, which is no number")
    return value


def _dotted(node: ast.expr) -> str:
    """Return a dotted name; raise AttributeError for another expression."""
    return f"{_dotted(node.value)}.{node.attr}" if isinstance(node, ast.Attribute) else node.id  # type: ignore[attr-defined]
