"""Policies that choose a patrol by a network: folders with `choice.json`, and the policies that they make."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import baselines
from baselines.policies.base import Policy, UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env import Scenario
from lissajous_env import scenario as make_scenario
from lissajous_env.parameters.scenario_file import scenario_of
from lissajous_env.settings.checks import whole_number
from lissajous_env.storage.files import read_json
from lissajous_env.wording import few_of, shown
from training.choosing.candidates import Candidate
from training.choosing.features import FEATURES
from training.choosing.playing import DETECTION, GUARANTEE
from training.choosing.rehearsing import best_rehearsed, complementary
from training.learned import policy
from training.learned.network import Network

FILE = "choice.json"
FORMAT = 3
_LONGEST = 400
"""Most letters of a message about a damaged file, which can contain any text."""
_SHIPPED = Path(__file__).parent.parent / "policies"


@dataclass(frozen=True)
class Chooser:
    """A network that ranks candidates by the numbers of a scenario.

    Raises:
        ValueError: the network does not map the numbers to an output for each candidate, or a name is unknown.
    """

    network: Network
    features: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    limits: tuple[tuple[float, float], ...]
    """Smallest and largest value of each number that is accepted."""
    seen: tuple[tuple[float, float], ...]
    """Smallest and largest value of each number in the training; the network reads the nearest one in this range."""
    about: Mapping[str, Any]
    """The options of `lissajous choose`."""
    home: Mapping[str, Any]
    """First scenario of the training as plain values of `Scenario.to_dict`, including derived fields."""
    rehearsed: int = 0
    """Number of candidates that are played in simulation before one of them is chosen, twice as many for a scenario
    with a number that the training has not seen; 0: the best ranked one is chosen."""
    errors: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    """Costs (E, K) of the candidates less the predicted ones, in scenarios that a fit did not use."""

    def __post_init__(self) -> None:
        for name in self.features:
            if name not in FEATURES:
                raise ValueError(f"features must be of {few_of(FEATURES, name)}, got {shown(name)}")
        sizes = len(self.features), len(self.candidates)
        if (self.network.inputs, self.network.outputs) != sizes:
            got = f"{self.network.inputs} to {self.network.outputs}"
            raise ValueError(f"network must map {sizes[0]} features to {sizes[1]} candidates, got {got}")
        if self.rehearsed > 0 and self.about.get("objective") not in (DETECTION, GUARANTEE):
            got = shown(self.about.get("objective"))
            raise ValueError(f"about must contain the objective, {DETECTION} or {GUARANTEE}, got {got}")
        if self.rehearsed > 0 and (self.errors.ndim != 2 or self.errors.shape[1] != sizes[1] or not len(self.errors)):
            raise ValueError(f"errors must have a row or more of {sizes[1]} numbers, got shape {self.errors.shape}")
        for name in ("limits", "seen"):
            if np.shape(getattr(self, name)) != (sizes[0], 2):
                raise ValueError(f"{name} must have a lowest and a highest value for each of {sizes[0]} features")

    def ranked(self, scenario: str | Scenario) -> list[PolicySettings]:
        """Return the candidates for a scenario, the best first.

        Raises:
            UnsuitableScenarioError: the robots are not cars, or a number of the scenario is outside of the limits.
        """
        made = make_scenario(scenario).resolve()
        ranks = np.argsort(-self._values(made), kind="stable")
        return [self.candidates[k].settings(made) for k in ranks]

    def chosen(self, scenario: str | Scenario) -> list[PolicySettings]:
        """Return the candidates in the order in which they are tried: as ranked, the best rehearsed one before others.

        Raises:
            UnsuitableScenarioError: see `ranked`.
        """
        found = self.ranked(scenario)
        if self.rehearsed > 0:
            made = make_scenario(scenario).resolve()
            varied = [self.candidates[k].settings(made) for k in complementary(-self._values(made), self.errors)]
            count = self.rehearsed if self._has_seen(made) else 2 * self.rehearsed
            best = best_rehearsed(varied, made, self.about["objective"], count)
            if best is not None:
                found.remove(varied[best])
                found.insert(0, varied[best])
        return found

    def _values(self, scenario: Scenario) -> np.ndarray:
        """Return the network's output (K,) for each candidate in a resolved scenario."""
        if scenario.robot.kind != "car":
            raise UnsuitableScenarioError(f"robot.kind must be car, got {scenario.robot.kind}")
        features, values = [FEATURES[name] for name in self.features], self._numbers(scenario)
        for feature, value, (low, high) in zip(features, values, self.limits, strict=True):
            if not low <= value <= high:
                least = f"from {feature.written(low)} to" if feature.as_logarithm else "at most"
                rule = f"must be {least} {feature.written(high)}, for which patrols are chosen"
                raise UnsuitableScenarioError(f"{feature.meaning} {rule}, got {feature.written(value)}")
        low, high = np.array(self.seen).T
        return outputs(self.network, np.clip(values, low, high))

    def _numbers(self, scenario: Scenario) -> np.ndarray:
        return np.array([float(FEATURES[name].read(scenario)) for name in self.features])

    def _has_seen(self, scenario: Scenario) -> bool:
        low, high = np.array(self.seen).T
        values = self._numbers(scenario)
        return bool(np.all((low <= values) & (values <= high)))

    def make(self, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
        """Make the best candidate that the scenario suits.

        Raises:
            ValueError: no candidate suits it; or see `ranked`.
        """
        reason: ValueError | None = None
        for settings in self.chosen(scenario):
            try:
                return settings.make(make_scenario(scenario), num_worlds, device)
            except UnsuitableScenarioError as error:
                reason = reason or error
        assert reason is not None
        raise reason

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> "Chooser":
        """Read the chooser of a folder, or an included one by name.

        Raises:
            ValueError: there is none, or the file is damaged; the message names it.
        """
        path = (_SHIPPED / folder if str(folder) in names() else Path(folder)) / FILE
        text = read_json(path)
        try:
            return cls._from_dict(text)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            words = f"it must contain {error}" if isinstance(error, KeyError) else str(error)
            raise ValueError(f"{path} is damaged: {words[:_LONGEST]}") from None

    @classmethod
    def _from_dict(cls, text: dict[str, Any]) -> "Chooser":
        if text["format"] != FORMAT:
            raise ValueError(f"format must be {FORMAT}, got {shown(text['format'])}")
        layers = text["network"]["layers"]
        network = Network(
            tuple(np.array(layer["weight"]) for layer in layers),
            tuple(np.array(layer["bias"]) for layer in layers),
            text["network"]["activation"],
        )
        return cls(
            network=network,
            features=tuple(text["features"]),
            candidates=tuple(Candidate(**each) for each in text["candidates"]),
            limits=tuple((float(low), float(high)) for low, high in text["limits"]),
            seen=tuple((float(low), float(high)) for low, high in text["seen"]),
            about=dict(text["about"]),
            home=dict(text["scenario"]),
            rehearsed=whole_number("rehearsed", text["rehearsed"], 0),
            errors=np.array(text["errors"], float),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the contents of `choice.json`."""
        layers = [
            {"weight": _rounded(weight), "bias": _rounded(bias)}
            for weight, bias in zip(self.network.weights, self.network.biases, strict=True)
        ]
        return {
            "format": FORMAT,
            "about": dict(self.about),
            "rehearsed": self.rehearsed,
            "errors": _rounded(self.errors),
            "scenario": dict(self.home),
            "features": list(self.features),
            "limits": [list(each) for each in self.limits],
            "seen": [list(each) for each in self.seen],
            "candidates": [each.to_dict() for each in self.candidates],
            "network": {"activation": self.network.activation, "layers": layers},
        }


def _rounded(array: np.ndarray) -> Any:
    """Return nested lists of numbers of five digits, which is more than the choice depends on."""
    return [_rounded(row) for row in array] if array.ndim > 1 else [float(f"{value:.5g}") for value in array]


def outputs(network: Network, values: np.ndarray) -> np.ndarray:
    """Return the outputs (K,) of a network, computed in float64."""
    activation = {"relu": lambda x: np.maximum(x, 0), "tanh": np.tanh}[network.activation]
    for weight, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        values = activation(weight.astype(np.float64) @ values + bias)
    return network.weights[-1].astype(np.float64) @ values + network.biases[-1]


def chosen(name: str | os.PathLike[str], scenario: str | Scenario) -> PolicySettings:
    """Return the policy and the parameters that an included chooser, or one in a folder, plays on a scenario.

    Raises:
        ValueError: there is no such chooser, or no candidate suits the scenario.
    """
    chooser = Chooser.read(name)
    for settings in chooser.chosen(scenario):
        try:
            settings.make(make_scenario(scenario))
        except UnsuitableScenarioError:
            continue
        return settings
    raise UnsuitableScenarioError(f"no candidate of {name} suits the scenario")


def load(name: str | Path, scenario: str | Scenario | None = None, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Load an included policy by name, or the policy in the folder of a training or of `lissajous choose`.

    Args:
        name: Name or folder.
        scenario: Scenario to play; by default that of the training, or the first one of its space.
        num_worlds: W.
        device: Warp device.

    Raises:
        ValueError: there is no such name or folder, a file is damaged, or the policy does not fit the scenario.
    """
    if str(name) in names() or Path(name, FILE).is_file():
        return _make(str(name), _home(str(name)) if scenario is None else scenario, num_worlds, device)
    return policy.load(name, scenario, num_worlds, device)


def names() -> tuple[str, ...]:
    """Return the names of the included choosers."""
    return tuple(sorted(path.parent.name for path in _SHIPPED.glob(f"*/{FILE}")))


def register_shipped() -> None:
    """Register the included choosers in `baselines`, which then also accepts the folder of one as a name."""
    baselines.register_opener(_make, _home, _parts, FILE)
    for name in names():
        baselines.register(name, "car", partial(_make, name), about=_about(name), learned=True, on_request=True)


def _about(name: str) -> str:
    about = json.loads((_SHIPPED / name / FILE).read_text(encoding="utf-8"))["about"]
    purpose = "a short worst case" if about["objective"] == GUARANTEE else "a short detection time"
    filtered = " with the proved filter" if about["proved"] else ""
    return f"Plays a patrol{filtered} for {purpose} that a network chooses, learned on {about['space']}."


def _make(folder: str, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    made = Chooser.read(folder).make(scenario, num_worlds, device)
    made.name = str(folder)
    return made


def _home(folder: str) -> Scenario:
    home = Chooser.read(folder).home
    if home.get("extensions"):
        raise ValueError(f"scenario must be given for {folder}: loading a folder never imports extensions")
    return scenario_of(home)


def _parts(folder: str) -> dict[str, str]:
    text = json.dumps(Chooser.read(folder).to_dict(), sort_keys=True)
    return {f"choice of {FILE}": hashlib.sha256(text.encode()).hexdigest()[:16]}
