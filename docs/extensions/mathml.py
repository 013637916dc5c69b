"""Equations as MathML, which browsers show by themselves: no script, no font, no network."""

from docutils.nodes import SkipNode, math, math_block
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_inline, None), (_displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(translator: HTML5Translator, node: math) -> None:
    translator.body.append(tex2mathml(node.astext()))
    raise SkipNode


def _displayed(translator: HTML5Translator, node: math_block) -> None:
    equation = tex2mathml(node.astext().strip(), as_block=True)
    translator.body.append(f'<div class="equation" tabindex="0">{equation}</div>')
    raise SkipNode
