"""Errors for optional dependencies that are not installed."""


class MissingExtraError(ValueError, ImportError):
    """Error for missing libraries of an extra; the message explains how to install them."""


def missing(what: str, extra: str, error: ImportError) -> MissingExtraError:
    """Return the error that names the extra to install."""
    return MissingExtraError(
        f'{what} requires the libraries of the extra {extra} ({error}): pip install ".[{extra}]" in a checkout, '
        f'pip install "lissajous-env[{extra}]" elsewhere'
    )
