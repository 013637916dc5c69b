"""What scrolls sideways, code and tables, can be reached and scrolled by keyboard."""

import re

from sphinx.application import Sphinx

SCROLLS = re.compile(r'(?<=<div class="highlight">)<pre\b|<div class="table-wrapper[^"]*"')


def setup(app: Sphinx) -> dict[str, bool]:
    """Change pages before they are written."""
    app.connect("html-page-context", _make_reachable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _make_reachable(app, page, template, context, doctree):
    if "body" in context:
        context["body"] = SCROLLS.sub(lambda found: f'{found[0]} tabindex="0"', context["body"])
