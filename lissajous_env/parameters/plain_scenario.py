"""Make a scenario from the plain values of a file, without looking up names or importing anything."""

from collections.abc import Iterable, Mapping
from typing import Any

from lissajous_env.parameters.extensions import Extension
from lissajous_env.parameters.scenario import ADDED, PARTS, Scenario


def scenario_of(plain: Mapping[str, Any], extensions: Iterable[Extension] = ()) -> Scenario:
    """Make a scenario from the values of `Scenario.to_dict` after JSON, with lists and with infinity as a word.

    Args:
        plain: The values; their extensions are ignored.
        extensions: The scenario's extensions.

    Raises:
        ValueError: a part or a field is missing or unknown, or a value is invalid; the message names it.
    """
    try:
        if unknown := sorted(plain.keys() - {"name", "description", "extensions", *PARTS}):
            raise ValueError(f"scenario must contain no {unknown[0]}")
        given = ADDED | dict(plain)
        parts: dict[str, Any] = {
            part: kind(**{field: _number(value) for field, value in given[part].items()})
            for part, kind in PARTS.items()
        }
        return Scenario(plain["name"], plain["description"], **parts, extensions=tuple(extensions))
    except KeyError as error:
        raise ValueError(f"scenario must contain {error.args[0]}, got {', '.join(map(str, plain))[:100]}") from error
    except (TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"scenario must contain the parts and fields of a scenario: {error}") from error


def _number(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return tuple(map(_number, value))
    return float(value) if value in ("inf", "-inf") else value
