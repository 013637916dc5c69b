"""Links from each name of the reference to its example, and pages of those that no page shows.

A page for each room holds what tests and code show of its names.
"""

import re
from collections import defaultdict
from pathlib import Path

from rooms import write
from sphinx.application import Sphinx
from uses import Use, examples, public

FOLDER = "generated/examples"


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before pages are read, and link each name to its example."""
    app.connect("builder-inited", lambda app: write_pages(Path(app.srcdir) / FOLDER))
    app.connect("autodoc-process-docstring", _link, priority=700)  # after numpydoc
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write_pages(folder: Path) -> None:
    """Write a page for each room: of its tests and code, what shows its names in use."""
    folder.mkdir(parents=True, exist_ok=True)
    shown = defaultdict(set)
    for key, use in examples().items():
        if use.rank >= 2:
            shown[public()[key][0]].add(use)
    for room, found in shown.items():
        title = f"Examples of {room}"
        lines = [":orphan:", "", title, "=" * len(title), ""]
        for use in sorted(found, key=lambda each: (str(each.path), each.first)):
            lines += _section(room, use)
        write(folder / f"{room}.rst", lines)


def _section(room: str, use: Use) -> list[str]:
    title = f"{use.path}{use.within and f', {use.within}'}"
    return [
        f".. _{_label(room, use)}:",
        "",
        f"``{title}``",
        "-" * (len(title) + 4),
        "",
        f".. literalinclude:: /../{use.path}",
        f"   :lines: {use.first}-{use.last}",
        "",
    ]


def _label(room: str, use: Use) -> str:
    return re.sub(r"\W+", "-", f"example {room} {use.path} {use.first}").lower()


def _link(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]):
    """Add a link to its example to the docstring of a public name."""
    use = examples().get(id(thing)) if what in ("class", "function", "exception") else None
    if use is None:
        return
    if use.rank < 2:
        inner = use.path.relative_to("docs").with_suffix("")
        page = f"generated/{inner}" if use.rank else str(inner)
        lines += ["", f"*Example:* :doc:`/{page}`", ""]
    else:
        text = f"{use.path}{use.within and f', {use.within}'}"
        label = _label(public()[id(thing)][0], use)
        lines += ["", f"*Example:* :ref:`{text} <{label}>`", ""]
