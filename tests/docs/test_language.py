"""Texts read plainly: the field's terms, short sentences, short lines. `docs/style.md` says why."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

from .pages import DOCS

ROOT = DOCS.parent
SOURCE_FOLDERS = ("assets_gen", "flow", "megalopta", "render", "scenes", "sensor")

# Lower this number whenever docstrings are rewritten; it never rises. The aim is 30.
FRAGMENTS_ALLOWED = 326
FRAGMENT = {"Of", "What", "Whether", "Which", "Where", "How", "That", "From"}

README_WORDS = 900
LINE_LENGTH = 120
LONG_SENTENCE_WORDS = 28
LONG_SENTENCES_SHARE = 0.05

BANNED = {
    "the answer 0": "zero motion",
    "stands? beside": "is stored with, is shown next to",
    "of yours": "your",
    "(?:is|are) ours": "this project's",
    "mend(?:ed|s)?": "repair",
    "told": "reported, stated",
    "untold": "unconstrained",
    "more than it": "more",
    "one method more": "an additional method",
    "with another method more": "with an additional method",
    "what stands": "the fixed part",
    "left out": "omitted, excluded",
    "beyond sense": "unreasonable",
    "in words": "in a sentence",
    "be had": "is available",
    "put at": "set to",
    "go(?:es|ne|ing)? on": "continue, resume",
    "free[- ]running(?!`| 8)": "continuous",
    "front door": "public API",
    "rooms?": "package",
    "making things": "generation",
    "beyond chance": "statistically significant",
    "hits? more": "longer paths",
    "as a whole sees": "covers",
    "what is absurd": "unreasonable requests",
    "when the new is whole": "once the new output is complete",
    "cannot be believed": "limits",
    "bear(?:s)? out": "support",
    "kin": "related methods",
}
"""Regular expressions of terms that are not used, and the words to use instead"""


def pages():
    """Every Markdown page that git tracks."""
    listed = subprocess.run(
        ["git", "-C", str(ROOT), "ls-files", "*.md"], capture_output=True, text=True, check=True
    )
    return [path for name in listed.stdout.splitlines() if (path := ROOT / name).exists()]


PAGES = pages()


def prose(text):
    """Text of a page without code, formulas, tables and pictures."""
    fences = re.sub(r"```.*?```|\$\$.*?\$\$", " ", text, flags=re.DOTALL)
    return re.sub(r"^(?:    | *\||!\[).*$", " ", fences, flags=re.MULTILINE)


def sentences(text):
    """Sentences of a page; a colon, too, ends one, and so do a blank line and a list's item."""
    parts = re.split(r"(?<=[.!?:])\s+|\n\s*\n|\n(?=\s*[-*] )", prose(text))
    return [part for part in parts if len(part.split()) > 3]


def name(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_page_has_no_term_that_is_not_used(page):
    text = re.sub(r"`[^`]*`|\]\([^)]*\)", " ", prose(page.read_text("utf-8")))
    if page == DOCS / "style.md":  # its right column names them in a table, which prose() drops
        assert "| not |" not in text
    found = [
        f"{match[0]!r}: write {instead!r}"
        for term, instead in BANNED.items()
        for match in re.finditer(rf"\b{term}\b", text, re.IGNORECASE)
    ]
    assert not found, "\n".join(found)


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text("utf-8").split()) <= README_WORDS


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_lines_are_short(page):
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)
    long = [
        line
        for line in text.splitlines()
        if len(line) > LINE_LENGTH and not line.startswith(("    ", "|", "!["))
    ]
    assert not long, "\n".join(long)


def test_few_sentences_are_long():
    found = [each for page in PAGES for each in sentences(page.read_text("utf-8"))]
    long = [each for each in found if len(each.split()) > LONG_SENTENCE_WORDS]
    assert len(long) <= LONG_SENTENCES_SHARE * len(found), "\n\n".join(long)


def first_words(path):
    """First word of each docstring of a module, its classes and its functions."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            words = (ast.get_docstring(node) or "").split()
            yield words[0].strip("`,.:") if words else ""


def test_docstrings_name_what_they_describe():
    files = [path for folder in SOURCE_FOLDERS for path in (ROOT / folder).rglob("*.py")]
    found = [word for path in files for word in first_words(path) if word in FRAGMENT]
    assert len(found) <= FRAGMENTS_ALLOWED
