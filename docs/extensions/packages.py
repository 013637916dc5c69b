"""Reference: a page for each package, of what its `__init__.pyi` publishes, from docstrings."""

import importlib
import inspect
import re
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import BaseModel

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDER = "generated/reference"
PACKAGES = (
    "megalopta",
    *(f"megalopta.{name}" for name in ("assets_gen", "scenes", "render", "sensor", "flow")),
)
# numpy.typing.NDArray[np.float64], written out.
ARRAY = re.compile(
    r"~?(?:numpy\.)?ndarray\[tuple\[~?(?:typing\.)?Any, \.\.\.\], "
    r"~?(?:numpy\.)?dtype\[~?(?:numpy\.)?(\w+)\]\]"
)


def setup(app: "Sphinx") -> dict[str, bool]:
    """Write the pages before pages are read."""
    app.connect("builder-inited", lambda app: write_pages(Path(app.srcdir) / FOLDER))
    app.connect("autodoc-process-signature", _shorten)
    app.connect("autodoc-process-docstring", _as_written, priority=300)  # before numpydoc
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write_pages(folder: Path) -> None:
    """Write a page for every package, and their list; pages that are the same stay untouched."""
    folder.mkdir(parents=True, exist_ok=True)
    index = ["API reference", "=============", ""]
    index += ["Import a name from the package that publishes it.", ""]
    pages = {}
    for name in PACKAGES:
        module = importlib.import_module(name)
        index.append(f"- :doc:`{name}`: {(module.__doc__ or '').partition(chr(10))[0]}")
        things = {published: getattr(module, published) for published in sorted(module.__all__)}
        values = [
            f"``{published}``"
            for published, thing in things.items()
            if not (inspect.isclass(thing) or inspect.isroutine(thing))
        ]
        # Not in the site's menu, which would be longer than most pages.
        lines = [":orphan:", "", name, "=" * len(name), "", f".. automodule:: {name}", ""]
        pages[name] = [*lines, f"Values and types: {', '.join(values)}." if values else ""]
    for name, lines in {**pages, "index": index}.items():
        path, text = folder / f"{name}.rst", "\n".join([*lines, ""])
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def _shorten(app, what, name, thing, *rest):
    """Omit a model's fields, which are in its table, and shorten the types of arrays."""
    _options, signature, returns = rest
    if isinstance(thing, type) and issubclass(thing, BaseModel):
        return "(...)", returns
    short = (text and ARRAY.sub(r"NDArray[\1]", text) for text in (signature, returns))
    return tuple(short)


def _as_written(app, what, name, thing, options, lines):
    """Keep the lines of indented equations, and bars as bars."""
    kept: list[str] = []
    for line in lines:
        depth = len(line) - len(line.lstrip())
        above = next((text for text in reversed(kept) if text.strip()), "")
        margin = above[: len(above) - len(above.lstrip())]
        is_start = line.strip() and kept and not kept[-1].strip()
        if is_start and depth >= 4 + len(margin) and not above.rstrip().endswith("::"):
            kept += [f"{margin}::", ""]
        kept.append(line)
    parts = "\n".join(kept).split("`")
    parts[::2] = [re.sub(r"(?<!\\)\|", r"\\|", part) for part in parts[::2]]
    lines[:] = "`".join(parts).split("\n")
