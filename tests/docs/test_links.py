"""Internal links hold: files, headings, pages that are made, names of the reference. Without Sphinx.

`make docs`, at which any warning is an error, checks the same on the site that it builds.
"""

import importlib
import re

import pytest

from .pages import DOCS, PAGES, REPOSITORY_PAGES

FENCED = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
LINK = re.compile(
    r"!?\[[^\]]*\]\(([^)\s]+)\)|\{download\}`[^<`]*<([^>]+)>`|^\[[^\]]+\]: (\S+)$", re.MULTILINE
)
ROLE = re.compile(r"\{py:\w+\}`~?([\w.]+)`")
CODE = re.compile(r"`((?:sensor|flow|render|scenes|tests|megalopta)/(?!\S*NAME)[\w/]+\.py)`")
SCRIPT = re.compile(r"(?:sphx_glr_)?((?:plot|fig|table|times)_\w+?)(?:_\d{3}\.png)?$")
SCRIPTS = {p.stem for p in (*DOCS.glob("gallery/**/*.py"), *DOCS.glob("../examples/*/*.py"))}
MADE = {
    f"generated/{page}"
    for page in ("configuration", "gallery/index", "dissertation/index", "reference/index")
}


def name(page):
    return str(page.relative_to(DOCS.parent))


def anchors(page):
    """Anchors of a page's headings, as GitHub and MyST make them."""
    text = FENCED.sub("", page.read_text("utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    plain = (re.sub(r"[`*]|\]\([^)]*\)|\[", "", title).lower() for title in titles)
    return {re.sub(r"[^\w\- ]", "", title).replace(" ", "-") for title in plain}


def holds(page, link):
    if re.match(r"[a-z]+:", link):
        return True
    path, _, anchor = link.partition("#")
    target = (page.parent / path).resolve() if path else page
    if "generated" in target.parts:
        made = str(target.relative_to(DOCS)).removesuffix(".rst").removesuffix(".html")
        script = SCRIPT.search(target.name)
        return made in MADE or bool(script and script[1] in SCRIPTS)
    return target.exists() and (not anchor or anchor in anchors(target))


@pytest.mark.parametrize("page", [*PAGES, *REPOSITORY_PAGES], ids=name)
def test_what_a_page_links_is_there(page):
    text = FENCED.sub("", page.read_text("utf-8"))
    links = {a or b or c for a, b, c in LINK.findall(text)}
    broken = [link for link in links if not holds(page, link)]
    broken += [path for path in CODE.findall(text) if not (DOCS.parent / path).exists()]
    assert not broken, broken
    for full in ROLE.findall(text):
        package, _, published = full.rpartition(".")
        assert published in importlib.import_module(package).__all__, full
