"""Texts read plainly: the field's terms, short sentences, short lines. `docs/style.md` says why."""

import ast
import re

import pytest

from .pages import DOCS, PAGES as DOCS_PAGES, REPOSITORY_PAGES

ROOT = DOCS.parent
SOURCE_FOLDERS = ("assets_gen", "flow", "megalopta", "render", "scenes", "sensor")

FRAGMENTS_ALLOWED = 2
FRAGMENT = {"Of", "What", "Whether", "Which", "Where", "How", "That", "From"}

LINE_LENGTH = 120
LONG_SENTENCE_WORDS = 28
LONG_SENTENCES_SHARE = 0.05

BANNED = {
    "the answer 0": "zero motion",
    "(?:noise-free|the|its|all|an) answers?": "response, estimate, reply",
    "stands? (?:beside|side|below|above|behind|wherever|in the|there)": "is shown, is stored",
    "standing (?:error|pattern)": "fixed error, fixed pattern",
    "beside": "next to, with",
    "of yours": "your",
    "(?:is|are) ours": "this project's",
    "that is ours": "this project's",
    "mend(?:ed|s)?": "repair",
    "(?:un)?told": "reported, stated",
    "(?:left|leaves) out": "omitted, excluded",
    "light left out": "truncation bias",
    "more than it": "more",
    "(?:one|another) method more": "an additional method",
    "beyond sense": "unreasonable",
    "what is absurd": "unreasonable requests",
    "in words": "in a sentence",
    "be had": "be available",
    "put at": "set to",
    "go(?:es|ne|ing)? on": "continue, resume",
    "goes? when": "is deleted once",
    "front door": "public API",
    "beyond chance": "statistically significant",
    "cannot be believed": "limits",
    "edges? of depth": "depth edge",
    "as it (?:is|stands) (?:by|there)": "unchanged",
}
"""Regular expressions of terms that are not used, and the words to use instead; code is free"""

PAGES = [
    *DOCS_PAGES,
    *REPOSITORY_PAGES,
    ROOT / "SECURITY.md",
    ROOT / "megalopta/report/dataset_card.md",
]


def prose(page):
    """Text of a page without code, formulas, tables and pictures."""
    fences = re.sub(r"```.*?```|\$\$.*?\$\$", " ", page.read_text("utf-8"), flags=re.DOTALL)
    return re.sub(r"^(?:    | *\||!\[).*$", " ", fences, flags=re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_has_short_lines_and_the_terms_of_the_style_page(page):
    text = re.sub(r"`[^`]*`|\]\([^)]*\)", " ", prose(page))
    found = [
        f"{match[0]!r}: write {instead!r}"
        for term, instead in BANNED.items()
        for match in re.finditer(rf"\b{term}\b", text, re.IGNORECASE)
    ]
    found += [line for line in prose(page).splitlines() if len(line) > LINE_LENGTH]
    assert not found, "\n".join(found)


def test_few_sentences_are_long():
    # a colon, too, ends a sentence, and so do a blank line and a list's item
    end = re.compile(r"(?<=[.!?:])(?:\*\*|\))?\s+|\n\s*\n|\n(?=\s*[-*] )")
    parts = [part for page in PAGES for part in end.split(prose(page))]
    sentences = [part for part in parts if len(part.split()) > 3]
    long = [each for each in sentences if len(each.split()) > LONG_SENTENCE_WORDS]
    assert len(long) <= LONG_SENTENCES_SHARE * len(sentences), "\n\n".join(long)


@pytest.mark.parametrize("folder", SOURCE_FOLDERS)
def test_docstrings_name_what_they_describe(folder):
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    openings = [
        (ast.get_docstring(node) or "").split()[:1]
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, kinds)
    ]
    found = [word for words in openings for word in words if word.strip("`,.:") in FRAGMENT]
    assert len(found) <= FRAGMENTS_ALLOWED
