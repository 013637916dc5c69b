"""Notebooks as pages: their text and code, without outputs, and the file to download."""

import json
from pathlib import Path
from typing import Any

from docutils.nodes import document
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx


class NotebookParser(MystParser):
    """Parser of a notebook whose text is MyST."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: document) -> None:
        """Parse the cells as one page."""
        name = Path(document["source"]).name
        cells = [_page_text(cell) for cell in json.loads(inputstring)["cells"]]
        super().parse("\n\n".join([*cells, f"{{download}}`Download {name} <{name}>`"]), document)


def _page_text(cell: dict[str, Any]) -> str:
    text = "".join(cell["source"])
    return text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the parser of .ipynb files."""
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
