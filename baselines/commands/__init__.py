"""The commands that play policies, a file each; pyproject.toml names them."""
