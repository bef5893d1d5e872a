"""Policies to compare against: the paper's method, its rivals, and what a person would try first."""
