"""The command line: entry point, help, output, and the display of recordings."""
