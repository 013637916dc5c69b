"""Equations as MathML, which browsers show by themselves: no script, no font, no network."""

from html import escape

from docutils.nodes import SkipNode, math, math_block
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger
from sphinx.writers.html5 import HTML5Translator

LOGGER = getLogger(__name__)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_inline, None), (_displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(translator: HTML5Translator, node: math) -> None:
    translator.body.append(_mathml(node, as_block=False))
    raise SkipNode


def _displayed(translator: HTML5Translator, node: math_block) -> None:
    equation = _mathml(node, as_block=True)
    translator.body.append(f'<div class="equation" tabindex="0">{equation}</div>')
    raise SkipNode


def _mathml(node: math | math_block, as_block: bool) -> str:
    try:
        return tex2mathml(node.astext().strip(), as_block=as_block)
    except MathError as error:
        LOGGER.warning("equation %r: %s", node.astext(), error, location=node)
        return f"<code>{escape(node.astext())}</code>"
