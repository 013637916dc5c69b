"""Reference: a page for each package, of what its `__init__.pyi` publishes, from docstrings."""

import importlib
import inspect
import re
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import BaseModel

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
FOLDER = "generated/reference"
FOLDERS = {
    "megalopta": "Datasets, and pictures of your own as photons",
    "assets_gen": "Shapes and textures from a seed",
    "scenes": "Objects, light, cameras and their motion",
    "render": "Radiance and truth",
    "sensor": "Light to readings and back",
    "flow": "Readings to motion",
}
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


def packages() -> dict[str, list[str]]:
    """Return the packages by their folder, as they are imported."""
    found = {}
    for folder in FOLDERS:
        stubs = sorted((ROOT / folder).rglob("__init__.pyi"))
        parts = (stub.parent.relative_to(ROOT).parts for stub in stubs)
        found[folder] = [".".join(p if p[0] == "megalopta" else ("megalopta", *p)) for p in parts]
    return found


def write_pages(folder: Path) -> None:
    """Write a page for every package, and their list."""
    folder.mkdir(parents=True, exist_ok=True)
    index = [
        "API reference",
        "=============",
        "",
        "Import a name from the package that publishes it.",
        "",
    ]
    homes = _homes([name for names in packages().values() for name in names])
    for top, names in packages().items():
        index += [FOLDERS[top], "-" * len(FOLDERS[top]), ""]
        index += [f"- :doc:`{name}`{_purpose(name)}" for name in names] + [""]
        for name in names:
            write(folder / f"{name}.rst", _page(name, homes))
    write(folder / "index.rst", index)


def _purpose(name: str) -> str:
    first = (importlib.import_module(name).__doc__ or "").partition("\n")[0]
    return f": {first}" if first else ""


def _homes(names: list[str]) -> dict[int, str]:
    """Return the innermost package that publishes each object, by the object's id."""
    inner_last = sorted(names, key=lambda name: name.count("."))
    modules = [importlib.import_module(name) for name in inner_last]
    return {id(getattr(each, name)): each.__name__ for each in modules for name in each.__all__}


def _page(name: str, homes: dict[int, str]) -> list[str]:
    module = importlib.import_module(name)
    has_entry = inspect.isclass, inspect.isroutine
    values, elsewhere = [], []
    for each in sorted(module.__all__):
        thing = getattr(module, each)
        if not any(is_one(thing) for is_one in has_entry):
            values.append(f"``{each}``")
        elif homes[id(thing)] != name:
            elsewhere.append(each)
    # Not in the site's menu, which would be longer than most pages.
    lines = [":orphan:", "", name, "=" * len(name), "", f".. automodule:: {name}"]
    lines += [f"   :exclude-members: {', '.join(elsewhere)}"] if elsewhere else []
    links = (f":py:obj:`{each} <{homes[id(getattr(module, each))]}.{each}>`" for each in elsewhere)
    lines += ["", f"Also exported: {', '.join(links)}.", ""] if elsewhere else [""]
    return [*lines, f"Values and types: {', '.join(values)}.", ""] if values else lines


def write(path: Path, lines: list[str]) -> None:
    """Write a page unless it is there: Sphinx reads again what is newer."""
    text = "\n".join(lines)
    if not path.exists() or path.read_text("utf-8") != text:
        path.write_text(text, "utf-8")


def _shorten(app, what, name, thing, *rest):
    """Omit a model's fields, which are in its table, and shorten the types of arrays."""
    _options, signature, returns = rest
    if isinstance(thing, type) and issubclass(thing, BaseModel):
        return "(...)", returns
    return signature and ARRAY.sub(r"NDArray[\1]", signature), returns and ARRAY.sub(
        r"NDArray[\1]", returns
    )


def _as_written(app, what, name, thing, options, lines):
    """Keep the lines of indented equations, and bars as bars."""
    kept: list[str] = []
    for line in lines:
        depth = len(line) - len(line.lstrip())
        above = next((each for each in reversed(kept) if each.strip()), "")
        starts = line.strip() and kept and not kept[-1].strip()
        deeper = depth >= 4 + len(above) - len(above.lstrip())
        if starts and deeper and not above.rstrip().endswith("::"):
            kept += [above[: len(above) - len(above.lstrip())] + "::", ""]
        kept.append(line)
    parts = "\n".join(kept).split("`")
    parts[::2] = [re.sub(r"(?<!\\)\|", r"\\|", part) for part in parts[::2]]
    lines[:] = "`".join(parts).split("\n")
