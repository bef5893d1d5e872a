"""A scenario from the plain values that a file holds: nothing is looked up by name, and nothing is imported."""

from collections.abc import Iterable, Mapping
from typing import Any

from lissajous_env.parameters.extensions import Extension
from lissajous_env.parameters.scenario import PARTS, Scenario


def scenario_of(plain: Mapping[str, Any], extensions: Iterable[Extension] = ()) -> Scenario:
    """Make the scenario of what `Scenario.to_dict` returned, as JSON holds it: lists, and infinity as a word.

    Args:
        plain: The values; what they say of extensions is not read.
        extensions: What the scenario brings.

    Raises:
        ValueError: a part or a field is missing or unknown, or a value breaks a rule; the message says which.
    """
    try:
        parts: dict[str, Any] = {
            part: kind(**{field: _number(value) for field, value in plain[part].items()})
            for part, kind in PARTS.items()
        }
        return Scenario(plain["name"], plain["description"], **parts, extensions=tuple(extensions))
    except KeyError as error:
        raise ValueError(f"scenario must hold {error.args[0]}, got {', '.join(map(str, plain))[:100]}") from error
    except (TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"scenario must hold the parts and fields of a scenario: {error}") from error


def _number(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return tuple(map(_number, value))
    return float(value) if value in ("inf", "-inf") else value
