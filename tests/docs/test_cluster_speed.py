"""The figures of a benchmark over a Ray cluster: they are made as the page shows them.

The other tests of the cluster refer to policies of their module, which every node must be able to import, and this one
imports the modules of `benchmarks`, which the nodes do not have.
"""

import pytest

pytest.importorskip("ray")

import figures
from speeds import Options, cluster


def test_one_node_and_two_are_measured_as_the_page_shows_them():
    # Oracle: the table that the page shows. Each side starts a cluster of its own.
    (table,) = cluster.tables(Options(rounds=1, worlds=1, threads=1, quick=True)).values()
    stored = figures.load()["cluster"]
    assert table["columns"] == stored["columns"]
    assert [row[0] for row in table["rows"]] == [row[0] for row in stored["rows"]]
    assert all(float(row[2]) > 0 for row in table["rows"])
