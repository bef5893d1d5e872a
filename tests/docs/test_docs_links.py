"""Links of README and docs, and the clicks to the answers that newcomers need; reads sources, without a build."""

import re

import pytest

from benchmarks import figures
from docs.generator import scenarios
from lissajous_env import scenario

ROOT = figures.ROOT
DOCS = ROOT / "docs"
PAGES = [*figures.PAGES, *sorted((DOCS / "notebooks").glob("*.md")), *sorted((DOCS / "api").glob("*.md"))]
MADE = "docs/scenarios/index.md", "docs/scenarios/intruders.md"
QUESTIONS = {
    "what does each entry mean": "docs/interface.md#observation-layout",
    "what does each entry mean, with numbers": "docs/scenarios/intruders.md#observation",
    "how is the reward computed": "docs/interface.md#reward",
    "what ends an episode": "docs/interface.md#what-ends-an-episode",
    "how do I add a policy": "docs/extending.md#a-policy",
    "how do I train on my rectangle": "docs/train.md#on-your-own-rectangle",
    "how many robots do I need": "docs/plan.md#how-many-robots-do-i-need",
    "how do I see why it failed": "docs/failures.md#see-why-it-failed",
    "how do I compare fairly": "docs/comparison.md#how-to-compare-fairly",
    "does it run on my cluster": "docs/train.md#on-a-cluster",
    "can I open a stranger's file": "SECURITY.md#data-safe-to-open",
}


@pytest.fixture(scope="module")
def texts():
    """Return the text of each page by its path, including pages that a build makes."""
    pages = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in PAGES}
    pages |= {name: (ROOT / name).read_text(encoding="utf-8") for name in ("SECURITY.md", "CONTRIBUTING.md")}
    one = scenario("intruders")
    return pages | dict(zip(MADE, (scenarios.listing([one]), scenarios.page(one, figures.load(), "")), strict=True))


def slugs(text):
    """Return the anchors of the headings of a page, as GitHub and MyST make them."""
    outside = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.+)$", outside, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def links(name, text):
    """Yield the target page, from the root, and the anchor of each link."""
    outside = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)\s]+)\)", outside):
        if "://" not in target:
            page, _, anchor = target.partition("#")
            place = (ROOT / name).parent / page if page else ROOT / name
            yield place.resolve().relative_to(ROOT).as_posix(), anchor


def test_every_link_leads_to_a_file_and_a_heading(texts):
    for name, text in texts.items():
        for page, anchor in links(name, text):
            if page in texts:
                # What a page includes has its headings.
                included = re.findall(r"^```\{include\} (\S+)$", texts[page], re.MULTILINE)
                whole = texts[page] + "".join((ROOT / page).parent.joinpath(path).read_text() for path in included)
                assert not anchor or anchor in slugs(whole), (name, page, anchor)
            elif not page.startswith(("docs/scenarios/", "docs/drawn/")):  # made with the site
                assert (ROOT / page).exists(), (name, page)


@pytest.mark.parametrize("first", ["README.md", "docs/index.md"])
@pytest.mark.parametrize("question", QUESTIONS)
def test_a_newcomer_finds_the_answer_within_two_clicks(first, question, texts):
    # Story: a person who reads one page follows a link, and at most one more.
    answer, _, heading = QUESTIONS[question].partition("#")
    if answer == "SECURITY.md" and first == "docs/index.md":
        assert "{include} ../SECURITY.md" in texts["docs/security.md"]
        answer = "docs/security.md"
    else:
        assert heading in slugs(texts[answer])
    if first == "README.md" and answer.startswith("docs/scenarios/"):
        assert "sphinx-build" in texts[first]
        return
    one = {page for page, _ in links(first, texts[first])}
    two = {page for name in one & set(texts) for page, _ in links(name, texts[name])}
    assert answer in one | two


def test_nothing_names_the_machine_that_wrote_it(texts):
    for name, text in texts.items():
        assert not re.search(r"/(?:tmp|work|root|home)/|localhost", text), name
