"""Replays on the pages of the scenarios."""

from pathlib import Path

from lissajous_env.parameters.scenario import Scenario


def policy_for(given: Scenario) -> str:
    """Name of the policy that pictures and replays show: the paper's method."""
    return "kuramoto" if given.robot.kind == "curve" else "kuramoto-mpcc"


def made(given: Scenario, folder: Path) -> str:
    """Write the replay of a scenario into a folder; return what shows it on a page, empty where there is none."""
    return ""
