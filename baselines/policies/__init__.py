"""Policies: what one is, the registry, and those that come with the package."""
