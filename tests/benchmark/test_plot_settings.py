"""Pictures of the package do not depend on the settings of matplotlib that its user has."""

import matplotlib
import pytest

import lissajous_env
from baselines.reproduce.drawing import Sheet, drawn_as
from lissajous_env.episodes.recording import record
from lissajous_env.render.sheet import save_sheet

HOSTILE = {
    "text.usetex": True, "savefig.bbox": "tight", "savefig.dpi": 37, "savefig.format": "svg",
    "savefig.transparent": True, "figure.dpi": 33, "font.family": "A font that nobody has", "axes.facecolor": "black",
    "lines.linewidth": 9, "image.cmap": "hot", "svg.fonttype": "none", "pdf.fonttype": 42, "path.simplify": False,
}  # fmt: skip


@pytest.fixture(scope="module")
def recording():
    policy = lissajous_env.policy("still", "experiment")
    return record(policy, lissajous_env.scenario("experiment", **{"task.duration": 0.5}), seed=1)


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_pictures_are_the_same_with_any_settings(suffix, recording, tmp_path):
    # Oracle: the pictures of a user without settings, bit for bit.
    def drawn(name):
        with drawn_as(suffix), Sheet("name", "Title with a $ sign", 5.0, 3.0) as sheet:
            axes = sheet.figure.subplots()
            axes.plot([0, 1, 2], [0, 1, -1], label="a line")
            axes.legend()
            picture = sheet.picture("A caption.").content
        save_sheet(recording, tmp_path / f"{name}.{suffix}")
        return picture, (tmp_path / f"{name}.{suffix}").read_bytes()

    expected = drawn("plain")
    with matplotlib.rc_context(HOSTILE):
        assert drawn("hostile") == expected
