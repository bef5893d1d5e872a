"""The benchmark: policies on scenarios, the same seeds for all, in a folder that survives a kill."""
