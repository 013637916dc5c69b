"""What a page says can be done, can be done as it stands there."""

import json

import numpy as np
import pytest

from .pages import DOCS, PAGES, blocks, run

NOTEBOOK = DOCS / "tutorials" / "notebook.ipynb"
# Pages that render or record: a minute each.
DEAR = {page for page in PAGES if any(block.language == "sh" for block in blocks(page))}


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(
            page, marks=[pytest.mark.slow] if page in DEAR else [], id=str(page.relative_to(DOCS))
        )
        for page in PAGES
        if blocks(page)
    ],
)
def test_the_blocks_of_a_page_run_one_after_the_other(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "page"}
    for block in blocks(page):
        run(block, tmp_path, names)


def test_the_notebook_is_stored_without_outputs():
    cells = json.loads(NOTEBOOK.read_text("utf-8"))["cells"]
    assert all(cell["outputs"] == [] for cell in cells if cell["cell_type"] == "code")


@pytest.mark.slow
def test_the_notebook_draws_photons_flow_and_errors():
    nbformat = pytest.importorskip("nbformat")
    client = pytest.importorskip("nbclient").NotebookClient
    executed = client(nbformat.read(NOTEBOOK, 4), timeout=300, kernel_name="python3").execute()
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
    printed = "".join(output.get("text", "") for output in outputs)
    assert printed == "".join(
        NOTEBOOK.with_name(f"notebook-{cell}.txt").read_text("utf-8") for cell in (2, 8)
    )
    errors = {
        name: list(map(float, rest)) for name, *rest in map(str.split, printed.splitlines()[-2:])
    }
    assert all(np.array(errors["PF"]) < errors["DIS"])
