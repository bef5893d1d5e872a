"""Multi-robot persistent monitoring and target detection on Lissajous curves, for PettingZoo and Gymnasium."""

from lissajous_env.library import scenario, scenarios
from lissajous_env.scenario import Scenario

__all__ = ["Scenario", "scenario", "scenarios"]
