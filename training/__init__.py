"""Learned policies: the included ones, and their training."""

from training.learned.policy import load, names
from training.learned.team_policy import LearnedTeam

__all__ = ["LearnedTeam", "load", "names"]
