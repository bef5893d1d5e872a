"""Settings of matplotlib for every picture of the package, which those of the user do not change."""

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from matplotlib import rc_context, rcParams, rcParamsDefault

_OF_THE_PROCESS = "backend", "interactive", "toolbar", "webagg", "figure.raise_window"
"""Beginnings of the names of settings that belong to windows, not to a picture."""


@contextmanager
def own_settings(style: Mapping[Any, Any]) -> Iterator[None]:
    """Let matplotlib have its defaults and a style, instead of the user's settings, while figures are made and saved.

    A file `matplotlibrc`, a style, fonts that are not installed or LaTeX then have no effect. Figures are made by
    `matplotlib.figure.Figure`, which needs no backend.
    """
    with rc_context():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a version of matplotlib warns of settings that a later one will not have
            plain: dict[Any, Any] = {
                name: rcParamsDefault[name] for name in rcParamsDefault if not name.startswith(_OF_THE_PROCESS)
            }
            rcParams.update(plain)
        rcParams.update(style)
        yield
