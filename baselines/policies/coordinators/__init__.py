"""Coordinators: the phase rate that each robot asks for."""
