"""Learned policies: the included ones, and their training."""

from training.learned.policy import LearnedTeam, load, names

__all__ = ["LearnedTeam", "load", "names"]
