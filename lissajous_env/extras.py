"""The extras: what is installed only where it is asked for, and the words for where it is missing."""


class MissingExtraError(ValueError, ImportError):
    """Libraries of an extra are not installed; the message says how to install them."""


def missing(what: str, extra: str, error: ImportError) -> MissingExtraError:
    """Error that says which extra brings what could not be imported, and how to install it."""
    return MissingExtraError(
        f'{what} must have the libraries of the extra {extra} ({error}): pip install ".[{extra}]" in a checkout, '
        f'pip install "lissajous-env[{extra}]" elsewhere'
    )
