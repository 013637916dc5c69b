"""The notebook runs from top to bottom, and is stored without outputs."""

import json

import numpy as np
import pytest

from .pages import DOCS

NOTEBOOK = DOCS / "tutorials" / "notebook.ipynb"


def test_the_notebook_is_stored_without_outputs():
    cells = json.loads(NOTEBOOK.read_text("utf-8"))["cells"]
    assert len(cells) <= 10
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell["outputs"] for cell in code] == [[]] * len(code)


@pytest.mark.slow
def test_the_notebook_draws_photons_flow_and_errors():
    nbformat = pytest.importorskip("nbformat")
    client = pytest.importorskip("nbclient").NotebookClient
    executed = client(nbformat.read(NOTEBOOK, 4), timeout=300, kernel_name="python3").execute()
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
    printed = "".join(output.get("text", "") for output in outputs)
    errors = {
        name: list(map(float, rest)) for name, *rest in map(str.split, printed.splitlines()[-2:])
    }
    assert all(np.array(errors["PF"]) < errors["DIS"])
