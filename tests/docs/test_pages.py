"""What a page says can be done, can be done as it stands there."""

import re

import pytest

from .pages import DOCS, PAGES, blocks, run

# Pages that render or record: a minute each.
DEAR = {page for page in PAGES if any(block.language == "sh" for block in blocks(page))}


def name(page):
    return str(page.relative_to(DOCS))


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.slow] if page in DEAR else [], id=name(page))
        for page in PAGES
        if blocks(page)
    ],
)
def test_the_blocks_of_a_page_run_one_after_the_other(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "page"}
    for block in blocks(page):
        run(block, tmp_path, names)


@pytest.mark.parametrize("page", [page for page in PAGES if page.parent.name == "theory"], ids=name)
def test_the_code_and_the_tests_that_theory_names_exist(page):
    for path in re.findall(
        r"`((?:sensor|flow|render|scenes|tests|megalopta)/[\w/]+\.py)`", page.read_text("utf-8")
    ):
        assert (DOCS.parent / path).exists(), f"{name(page)} names {path}"
