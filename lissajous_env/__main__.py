"""`python -m lissajous_env` is the command `lissajous`."""

from lissajous_env.console.cli import main

if __name__ == "__main__":
    main()
