"""Parts of the site: MathML without scripts, notebooks as pages, keyboards, style of figures."""

import json
import re
from html import escape
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode, document, math, math_block
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from matplotlib import style
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger
from sphinx.writers.html5 import HTML5Translator

LOGGER = getLogger(__name__)
# Code and tables scroll sideways, and by keyboard where they can be reached.
SCROLLS = re.compile(r'(?<=<div class="highlight">)<pre\b|<div class="table-wrapper[^"]*"')


class NotebookParser(MystParser):
    """Parser of a notebook whose text is MyST: text and code, and the file to download."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: document) -> None:
        """Parse the cells as one page."""
        name, pages = Path(document["source"]).name, []
        for place, cell in enumerate(json.loads(inputstring)["cells"]):
            text = "".join(cell["source"])
            pages.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
            output = Path(document["source"]).with_name(f"{Path(name).stem}-{place}.txt")
            if output.exists():
                pages.append(f"```{{literalinclude}} {output.name}\n```")
            if (picture := output.with_suffix(".png")).exists():
                pages.append(f"![What this cell draws]({picture.name})")
        super().parse("\n\n".join([*pages, f"{{download}}`Download {name} <{name}>`"]), document)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer `mathml` and the parser of .ipynb files."""
    app.add_html_math_renderer("mathml", (_equation, None), (_equation, None))
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
    app.connect("html-page-context", _make_reachable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def use_style(gallery_conf: dict[str, Any], name: str) -> None:
    """Set the style of figures before a script of the gallery runs; sphinx-gallery calls this."""
    style.use("megalopta.report.house")


def _equation(translator: HTML5Translator, node: math | math_block) -> None:
    is_block = isinstance(node, math_block)
    try:
        shown = tex2mathml(node.astext().strip(), as_block=is_block)
    except MathError as error:
        LOGGER.warning("equation %r: %s", node.astext(), error, location=node)
        shown = f"<code>{escape(node.astext())}</code>"
    box = '<div class="equation" tabindex="0">{}</div>' if is_block else "{}"
    translator.body.append(box.format(shown))
    raise SkipNode


def _make_reachable(app, page, template, context, doctree):
    if "body" in context:
        context["body"] = SCROLLS.sub(lambda match: f'{match[0]} tabindex="0"', context["body"])
