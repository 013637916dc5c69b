"""The promise: public names and signatures change only with a line in the changelog.

`public_api.txt` lists those of the last release. To list today's: python -P tests/test_public_api.py
"""

import ast
import importlib
import inspect
import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
RELEASED = Path(__file__).with_name("public_api.txt")
LIBRARIES = ("", ".assets_gen", ".flow", ".render", ".scenes", ".sensor")
BESIDE = (
    "megalopta.sensor.calibrate.crosstalk.modelled",
    "megalopta.sensor.ctia.integration.Pixel",
    "megalopta.sensor.ctia.integration.discharge",
    "megalopta.sensor.ctia.integration.gain_from_db",
    "megalopta.sensor.effects.crosstalk.mean",
    "megalopta.sensor.effects.dead_time.moments",
    "megalopta.sensor.information.information",
)
"""Public, too, in the module that says what they are of"""


def listing():
    """Every public name, with its signature if it is a function or its members if it is a class."""
    packages = [importlib.import_module(f"megalopta{library}") for library in LIBRARIES]
    names = [
        *BESIDE,
        *(f"{package.__name__}.{name}" for package in packages for name in package.__all__),
    ]
    places = (name.rpartition(".") for name in sorted(names))
    return {
        f"{at}.{name}": form(getattr(importlib.import_module(at), name)) for at, _, name in places
    }


def form(thing):
    if inspect.isfunction(thing):
        parameters = inspect.signature(thing).parameters.values()
        plain = (str(one.replace(annotation=one.empty)) for one in parameters)
        return f"({', '.join(re.sub(r'=(<|.{30}).*', '=...', text) for text in plain)})"
    if not inspect.isclass(thing):
        return "value"
    members = dict.fromkeys(getattr(thing, "__annotations__", {}), "")
    members |= {n: form(m) if inspect.isfunction(m) else "" for n, m in vars(thing).items()}
    own = (
        name + what
        for name, what in sorted(members.items())
        if not name.startswith(("_", "model_"))
    )
    return f": {', '.join(own)}"


def test_public_names_change_only_with_a_line_in_the_changelog():
    released = dict(line.split(" ", 1) for line in RELEASED.read_text("utf-8").splitlines())
    newest = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text("utf-8"), flags=re.MULTILINE)[1]
    told = newest if newest.startswith("[Unreleased]") else ""
    changed = {name.rpartition(".")[2] for name, _ in released.items() ^ listing().items()}
    assert not {name for name in changed if f"`{name}`" not in told}, "name them in CHANGELOG.md"


def scripts(path):
    """Python that a page, a notebook or a script shows its readers."""
    text = path.read_text("utf-8")
    if path.suffix == ".md":
        yield from re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    elif path.suffix == ".py":
        yield text
    else:
        code = (cell["source"] for cell in json.loads(text)["cells"] if cell["cell_type"] == "code")
        yield from ("".join(line for line in lines if line[0] not in "%!") for lines in code)


def test_pages_and_examples_import_public_names():
    public = listing().keys() | {f"megalopta{library}" for library in LIBRARIES}
    public |= {name.rpartition(".")[0] for name in BESIDE}
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("docs/**/*.ipynb")]
    pages += [*ROOT.glob("docs/gallery/**/*.py"), *ROOT.glob("examples/*.py")]
    private = {
        f"{path.name}: {node.module}.{alias.name}"
        for path in pages
        if "generated" not in path.parts
        for script in scripts(path)
        for node in ast.walk(ast.parse(script))
        if isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith("megalopta.")
        for alias in node.names
        if f"{node.module}.{alias.name}" not in public
    }
    assert not private, "publish it in an `__init__.pyi`"


if __name__ == "__main__":
    RELEASED.write_text("".join(f"{name} {what}\n" for name, what in listing().items()), "utf-8")
