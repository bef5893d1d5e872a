"""The collision filter under any car policy."""
