"""Contamination: where an undetected target may be, and for how long it can have stayed undetected."""
