"""Learned policies: shipped ones, and what trains them."""

from training.learned.policy import Learned, load, names

__all__ = ["Learned", "load", "names"]
