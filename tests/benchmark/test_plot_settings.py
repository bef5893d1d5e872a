"""Pictures of the package do not depend on the settings of matplotlib that its user has."""

import matplotlib
import pytest

from baselines.reproduce.drawing import sheet

HOSTILE = {
    "text.usetex": True, "savefig.bbox": "tight", "savefig.dpi": 37, "savefig.format": "svg",
    "savefig.transparent": True, "figure.dpi": 33, "font.family": "A font that nobody has", "axes.facecolor": "black",
    "lines.linewidth": 9, "axes.prop_cycle": "cycler('color', ['r'])", "svg.fonttype": "none", "pdf.fonttype": 42,
    "path.simplify": False, "figure.constrained_layout.use": False,
}  # fmt: skip


def drawn(suffix):
    with sheet("name", "Title with a $ sign", 5.0, 3.0) as picture:
        axes = picture.figure.subplots()
        axes.plot([0, 1, 2], [0, 1, -1], label="a line")
        axes.legend()
        picture.caption = "A caption."
    return picture.content(suffix)


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_pictures_are_the_same_with_any_settings(suffix):
    # Oracle: the picture of a user without settings, bit for bit.
    expected = drawn(suffix)
    with matplotlib.rc_context(HOSTILE):
        assert drawn(suffix) == expected
        assert matplotlib.rcParams["lines.linewidth"] == 9
