"""Colours of pictures for colour-blind readers: elements of a picture differ in visible colour or in their mark."""

import re
from itertools import combinations

import numpy as np
import pytest

from baselines import names
from baselines.benchmark import types
from baselines.benchmark.plot_styles import COLOURS, MARKS, style_at, styles_of
from baselines.policies.registry import split_suffix
from baselines.reproduce import drawing
from lissajous_env.render import palette
from lissajous_env.replay.page import text_of

# What is seen without one kind of cones, in linear RGB, at full severity. Oracle: G. M. Machado, M. M. Oliveira and
# L. A. F. Fernandes, "A physiologically-based model for simulation of color vision deficiency", IEEE TVCG 15(6), 2009.
SEEN = {
    "all cones": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
# Linear sRGB to CIE XYZ and the white of D65 (IEC 61966-2-1).
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = XYZ.sum(axis=1)
APART = 15
"""Distance in CIELAB (1976) from which two colours are two; 2.3 is a just noticeable difference of large patches."""
FILM = ("GROUND", "IDLE", "ROBOT", "FAILED", "REMOVED", "TARGET", "DETECTED", "CONTACT")


def from_hex(colour):
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


def lab(colour, seen):
    """CIELAB of an sRGB colour (3,) as somebody sees it."""
    part = np.asarray(colour) / 255
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    x, y, z = np.cbrt(XYZ @ np.clip(np.asarray(SEEN[seen]) @ linear, 1e-4, 1) / WHITE)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def distance(one, other, seen):
    return np.linalg.norm(lab(one, seen) - lab(other, seen))


def test_the_simulation_knows_what_is_confused():
    # Oracle: greys stay as they are; red and green of one lightness are one without the cones of either.
    for seen in SEEN:
        assert distance((128, 128, 128), (128, 128, 128), seen) == 0
        assert lab((255, 255, 255), seen) == pytest.approx([100, 0, 0], abs=0.1)
    red, green = (200, 60, 60), (92, 116, 60)
    assert distance(red, green, "all cones") > 50
    assert distance(red, green, "deuteranopia") < 15


@pytest.mark.parametrize("seen", SEEN)
def test_policies_are_told_apart_by_every_reader(seen):
    # Story: whichever policies a benchmark is asked to draw, no two have one colour and one mark.
    plain = list(dict.fromkeys(split_suffix(name)[0] for name in names()))
    styles = [style_at(place) for place in range(max(len(plain), len(COLOURS) * len(MARKS)))]
    for one, other in combinations(styles, 2):
        apart = distance(from_hex(one.colour), from_hex(other.colour), seen) > APART
        assert apart or one.mark != other.mark, (one, other)


@pytest.mark.parametrize("scenario", ["evaders", "redundant"])
@pytest.mark.parametrize("seen", SEEN)
def test_the_standard_policies_share_neither_colour_nor_mark(seen, scenario):
    # Story: a scenario of the README's command has a dozen policies; each has a colour that nobody takes for another's.
    played = [name for name in types.POLICIES if name in names(scenario)]
    plain = dict.fromkeys(split_suffix(name)[0] for name in played)
    styles = styles_of(plain)
    assert len({style.mark for style in styles.values()}) == len(plain)
    for one, other in combinations(styles.values(), 2):
        assert distance(from_hex(one.colour), from_hex(other.colour), seen) > APART, (one, other)


def test_a_policy_looks_the_same_whatever_else_is_drawn():
    alone, together = styles_of(["sweep"]), styles_of(["mine", *types.POLICIES])
    assert together["sweep"] == alone["sweep"]
    assert together["kuramoto-mpcc-safe"] == together["kuramoto-mpcc"] != together["sweep"]
    # One's own takes a style that is left, a colour that is left first, and of many no two look the same.
    assert together["mine"] not in {together[name] for name in types.POLICIES}
    assert styles_of(["b", "a"]) == styles_of(["a", "b"])
    assert len(set(styles_of([f"mine {k}" for k in range(60)]).values())) == 60
    assert len({style.colour for style in styles_of(["mine", "theirs", "lanes", "index", "still-safe"]).values()}) == 5


@pytest.mark.parametrize("seen", SEEN)
def test_curves_of_one_picture_are_told_apart_by_every_reader(seen):
    colours = {*drawing.SERIES, drawing.BLUE, drawing.ORANGE, drawing.GREEN, drawing.PINK, drawing.RED, drawing.DARK}
    for one, other in combinations(sorted(colours), 2):
        assert distance(from_hex(one), from_hex(other), seen) > APART, (one, other)


@pytest.mark.parametrize("seen", SEEN)
def test_what_meets_in_a_film_is_told_apart_by_every_reader(seen):
    for one, other in combinations(FILM, 2):
        assert distance(getattr(palette, one), getattr(palette, other), seen) > APART, (one, other)


def page_colours():
    """Colours of the robots, and the others by name, of the replay page."""
    text = re.search(r"const COLOURS = {(.*?)};", text_of("colours.js"), re.DOTALL)[1]
    robots, others = text.split("],", 1)
    return re.findall("#[0-9a-f]{6}", robots), dict(re.findall(r'(\w+): "(#[0-9a-f]{6})"', others))


@pytest.mark.parametrize("seen", SEEN)
def test_robots_and_marks_of_a_replay_page_are_told_apart_by_every_reader(seen):
    robots, others = page_colours()
    assert len(robots) == 8
    marks = [others[name] for name in ("target", "found", "failed", "touch", "unseen", "ground")]
    for one, other in [*combinations([*robots, others["ground"]], 2), *combinations(marks, 2)]:
        assert distance(from_hex(one), from_hex(other), seen) > APART, (one, other)


def test_every_colour_of_a_style_sheet_is_defined():
    sheets = text_of("style.css") + text_of("report.css")
    defined = {*re.findall(r"--([\w-]+):", sheets), *page_colours()[1]}
    assert set(re.findall(r"var\(--([\w-]+)\)", sheets)) - defined == {"picture"}, "which a drawing sets"
