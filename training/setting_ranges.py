"""Ranges of the settings of a training that do not depend on its scenario."""

import math
from collections.abc import Iterable
from typing import Any

from lissajous_env.wording import shown
from training.learned.network import ACTIVATIONS

_MOST = {
    "steps": 10**15,
    "worlds": 1_000_000,
    "groups": 10_000,
    "rollout": 1_000_000,
    "batch_size": 10**9,
    "imitation_batch": 10**9,
    "epochs": 10_000,
    "imitation_epochs": 10_000,
    "evaluate_every": 10**15,
    "evaluation_episodes": 65_536,
    "evaluation_scenarios": 10_000,
    "noise_steps": 10**9,
}
"""Largest value of each whole number, all of which must be at least 1; larger ones can only be typing errors."""
_POSITIVE = ("residual", "clip_range", "gradient_max", "short_time")


def parse_numbers(name: str, entries: Iterable[str]) -> dict[str, float]:
    """Parse numbers by name, as in ("cruise=1.9", "inset=0.1").

    Raises:
        ValueError: an entry is not of this form, or a name is given twice.
    """
    numbers: dict[str, float] = {}
    for entry in entries:
        word, equals, text = entry.partition("=")
        try:
            numbers[word] = float(text) if equals and word not in numbers else math.nan
        except ValueError:
            numbers[word] = math.nan
        if not math.isfinite(numbers[word]):
            raise ValueError(f"{name} must be given as name=number, each name once, got {shown(entry)}")
    return numbers


def require(settings: Any, name: str, holds: bool, rule: str) -> None:
    """Raise ValueError with the rule and the value of a setting that does not meet it."""
    if not holds:
        raise ValueError(f"{name} {rule}, got {getattr(settings, name)!r}")


def check_numbers(settings: Any) -> None:
    """Raise ValueError if a number, or a name that selects one of a few, is outside of its range."""
    for name, most in _MOST.items():
        value = getattr(settings, name)
        require(settings, name, value is None or value >= 1, "must be at least 1")
        require(settings, name, value is None or value <= most, f"must be at most {most:,}")
    require(settings, "seed", 0 <= settings.seed < 2**11, "must be from 0 to 2047")
    require(settings, "layers", all(size >= 1 for size in settings.layers), "must be sizes of at least 1")
    few = len(settings.layers) <= 100 and all(size <= 65_536 for size in settings.layers)
    require(settings, "layers", few, "must be at most 100 sizes of at most 65,536")
    require(settings, "activation", settings.activation in ACTIVATIONS, f"must be one of {', '.join(ACTIVATIONS)}")
    require(
        settings,
        "threads",
        settings.threads is None or 1 <= settings.threads <= 1024,
        "must be at least 1 and at most 1,024",
    )
    for name, most in (("learning_rate", 1), *((n, 1e6) for n in _POSITIVE)):
        require(settings, name, getattr(settings, name) > 0, "must be positive")
        require(settings, name, getattr(settings, name) <= most, f"must be at most {most:g}")
    for name in ("gamma", "gae_lambda", "short"):
        require(settings, name, 0 <= getattr(settings, name) <= 1, "must be from 0 to 1")
    require(settings, "averaging", 0 <= settings.averaging < 1, "must be at least 0 and below 1")
    for name in ("log_std", "log_std_end"):
        value = getattr(settings, name)
        require(settings, name, value is None or -20 <= value <= 2, "must be from -20 to 2")
    for name in ("entropy", "value_weight", "residual_penalty", "caution"):
        require(settings, name, getattr(settings, name) >= 0, "must not be negative")
        require(settings, name, getattr(settings, name) <= 1e6, "must be at most 1e6")
    for name in ("imitation_steps", "critic_steps"):
        require(settings, name, getattr(settings, name) >= 0, "must not be negative")
        require(settings, name, getattr(settings, name) <= _MOST["steps"], f"must be at most {_MOST['steps']:,}")
