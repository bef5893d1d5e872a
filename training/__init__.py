"""Learned policies: the included ones, and their training."""

from training.learned.policy import LearnedTeam as LearnedTeam
