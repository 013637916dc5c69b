"""Texts read plainly: the field's terms, short sentences, short lines. `docs/style.md` says why."""

import ast
import re

import pytest

from .pages import DOCS, PAGES as DOCS_PAGES, REPOSITORY_PAGES

ROOT = DOCS.parent
SOURCE_FOLDERS = ("assets_gen", "flow", "megalopta", "render", "scenes", "sensor")

# Lower these numbers whenever docstrings are rewritten; they never rise. The aim of the first is 30.
FRAGMENTS_ALLOWED = {"docstrings": 2, "attributes": 8}
FRAGMENT = {"Of", "What", "Whether", "Which", "Where", "How", "That", "From"}

README_WORDS = 900
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
    "rooms?": "package",
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


def prose(text):
    """Text of a page without code, formulas, tables and pictures."""
    fences = re.sub(r"```.*?```|\$\$.*?\$\$", " ", text, flags=re.DOTALL)
    return re.sub(r"^(?:    | *\||!\[).*$", " ", fences, flags=re.MULTILINE)


def sentences(text):
    """Sentences of a page; a colon, too, ends one, and so do a blank line and a list's item."""
    parts = re.split(r"(?<=[.!?:])(?:\*\*|\))?\s+|\n\s*\n|\n(?=\s*[-*] )", prose(text))
    return [part for part in parts if len(part.split()) > 3]


def name(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_page_uses_the_terms_of_the_style_page(page):
    text = re.sub(r"`[^`]*`|\]\([^)]*\)", " ", prose(page.read_text("utf-8")))
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
    text = re.sub(r"```.*?```|\$\$.*?\$\$", "", page.read_text("utf-8"), flags=re.DOTALL)
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


def test_the_glossary_is_in_alphabetical_order():
    text = (DOCS / "glossary.md").read_text("utf-8")
    terms = re.findall(r"^(\S.*)\n: ", text, re.MULTILINE)
    assert len(terms) >= 40
    assert terms == sorted(terms, key=str.casefold)


def texts(path, kind):
    """Docstrings of a module, its classes and functions, or those below attributes."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if not isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        if kind == "docstrings":
            yield ast.get_docstring(node) or ""
        else:
            constants = (each.value for each in node.body[1:] if isinstance(each, ast.Expr))
            yield from (each.value for each in constants if is_text(each))


def is_text(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


@pytest.mark.parametrize("kind", FRAGMENTS_ALLOWED)
def test_docstrings_name_what_they_describe(kind):
    files = [path for folder in SOURCE_FOLDERS for path in (ROOT / folder).rglob("*.py")]
    openings = (text.split()[:1] for path in files for text in texts(path, kind))
    found = [word for words in openings for word in words if word.strip("`,.:") in FRAGMENT]
    assert len(found) <= FRAGMENTS_ALLOWED[kind]
