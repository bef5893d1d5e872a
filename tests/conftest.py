"""Settings of every test: no window, no waiting, random numbers that repeat, and registries of its own."""

import gc
import os
import random
import signal
import sys

import numpy as np
import pytest
from browser import browser, folder, recording  # noqa: F401 - fixtures
from hypothesis import settings

import baselines
import lissajous_env
from baselines.policies import registry
from lissajous_env.parameters import named, robot_models, rogues

os.environ["SDL_VIDEODRIVER"] = "dummy"
os.environ["MPLBACKEND"] = "Agg"
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture(autouse=True)
def _same_draws():
    # The libraries' global generators continue from test to test: what one draws would hang on which ran before it.
    random.seed(0)
    np.random.seed(0)
    if "torch" in sys.modules:
        sys.modules["torch"].manual_seed(0)


@pytest.fixture(autouse=True)
def _own_registries(monkeypatch):
    # What one test registers, another must not see.
    baselines.names()
    lissajous_env.rogues()
    monkeypatch.setattr(sys, "path", list(sys.path))  # to which the current folder is added
    tables = registry.POLICIES, registry._FILTERS, robot_models.MODELS, rogues.ROGUES, named.ENTRIES
    before = [(table, dict(table)) for table in tables]
    yield
    for table, entries in before:
        table.clear()
        table.update(entries)


@pytest.fixture
def one_thread():
    """Let torch use one thread: its networks are small."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def ctrl_c():
    """Ctrl-C, SIGINT, ends this process and those that it starts, as in a terminal.

    Tests that a shell without job control runs in the background ignore it, and so would their children.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="also run the tests marked long: minutes each")


def pytest_collection_finish() -> None:
    # What has been imported stays: to look through it at each collection takes some percent of all tests.
    gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not config.getoption("--long"):
        skipped = pytest.mark.skip(reason="long: run it with --long")
        for item in items:
            if "long" in item.keywords:
                item.add_marker(skipped)
