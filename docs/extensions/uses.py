"""An example of every public name: a page, a script of the gallery, a test, or code that uses it.

Pages, scripts and tests run, so what they show holds. Of several examples a page comes first, then
a script, the shortest test, and the shortest function of the program. A class that nobody names is
shown by what gives it.
"""

import ast
import importlib
import inspect
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rooms import FOLDERS, ROOT, rooms

BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
NOT_PAGES = {"generated", "example_device", "extensions"}


@dataclass(frozen=True)
class Use:
    """Lines of a file that use a name."""

    rank: int
    """0 in a page, 1 in the gallery, 2 in a test, 3 in the program"""
    path: Path
    first: int
    last: int
    within: str
    """The function or class that these lines are"""


@cache
def public() -> dict[int, tuple[str, str, object]]:
    """Functions and classes that rooms publish, with room and name of each, by identity."""
    found: dict[int, tuple[str, str, object]] = {}
    for room in (room for inner in rooms().values() for room in inner):
        module = importlib.import_module(room)
        things = ((name, getattr(module, name)) for name in module.__all__)
        for name, thing in things:
            if inspect.isclass(thing) or inspect.isroutine(thing):
                found[id(thing)] = (room, name, thing)
    return found


@cache
def examples() -> dict[int, Use]:
    """The best example of each public name that has one, by identity."""
    found = {key: min(uses, key=_order) for key, uses in _uses().items() if key in public()}
    for key, (_, _, thing) in public().items():
        giving = [found[id(giver)] for giver in _givers(thing) if id(giver) in found]
        given = min(giving, key=_order, default=None)
        if given and (key not in found or given.rank < 2 <= found[key].rank):
            found[key] = given
    return found


def _order(use: Use) -> tuple[int, int, str]:
    return use.rank, use.last - use.first, str(use.path)


@cache
def _uses() -> dict[int, list[Use]]:
    found = defaultdict(list)
    for rank, path in _files():
        text = path.read_text("utf-8")
        for source in BLOCK.findall(text) if path.suffix == ".md" else [text]:
            own = _module(path) if rank == 3 else None
            for thing, first, last, within in _used(source, own):
                found[thing].append(Use(rank, path.relative_to(ROOT), first, last, within))
    return found


def _files() -> Iterator[tuple[int, Path]]:
    docs = ROOT / "docs"
    for page in sorted(docs.rglob("*.md")):
        if not NOT_PAGES & set(page.relative_to(docs).parts):
            yield 0, page
    yield from ((1, script) for script in sorted((docs / "gallery").glob("*.py")))
    yield from ((2, test) for test in sorted((ROOT / "tests").rglob("test_*.py")))
    for folder in FOLDERS:
        yield from ((3, code) for code in sorted((ROOT / folder).rglob("*.py")))


def _module(path: Path) -> str | None:
    """Name of a module of the program in which something public is defined."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    name = ".".join(parts if parts[0] == "megalopta" else ("megalopta", *parts))
    return name if name in {thing.__module__ for _, _, thing in public().values()} else None


def _used(source: str, own: str | None) -> Iterator[tuple[int, int, int, str]]:
    """Identities of what a source uses of this program, each with the statement it stands in."""
    tree = ast.parse(source)
    names = dict(_imported(tree)) | (dict(_defined(tree, own)) if own else {})
    for statement in tree.body:
        used = {id(thing) for thing in _loaded(statement, names)}
        decorators = getattr(statement, "decorator_list", [])
        first = min([statement.lineno, *(each.lineno for each in decorators)])
        within = getattr(statement, "name", "")
        used.discard(id(names.get(within)))
        for thing in used:
            yield thing, first, statement.end_lineno, within


def _loaded(statement: ast.stmt, names: dict[str, object]) -> Iterator[object]:
    for node in ast.walk(statement):
        if isinstance(node, ast.Name):
            yield names.get(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield getattr(names.get(node.value.id), node.attr, None)


def _imported(tree: ast.Module) -> Iterator[tuple[str, object]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("megalopta"):
            try:
                module = importlib.import_module(node.module)
            except ModuleNotFoundError:  # of an extra
                continue
            for alias in node.names:
                yield alias.asname or alias.name, getattr(module, alias.name, None)


def _defined(tree: ast.Module, module: str) -> Iterator[tuple[str, object]]:
    for node in tree.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name, getattr(importlib.import_module(module), node.name, None)


def _givers(thing: object) -> list[object]:
    """Public functions that return a class, and public classes that hold, take or return one."""
    if not inspect.isclass(thing):
        return []
    word = re.compile(rf"\b{thing.__name__}\b")
    return [giver for text, giver in _annotations() if giver is not thing and word.search(text)]


@cache
def _annotations() -> list[tuple[str, object]]:
    """What public functions return, and what public classes hold, take and return."""
    found = []
    for _, _, thing in public().values():
        if inspect.isclass(thing):
            fields = [str(each) for each in getattr(thing, "__annotations__", {}).values()]
            methods = filter(inspect.isfunction, vars(thing).values())
            given = [str(each.__annotations__.get("return", "")) for each in methods]
            taken = [str(each) for each in getattr(thing.__init__, "__annotations__", {}).values()]
            found.append((" ".join(fields + given + taken), thing))
        elif inspect.isfunction(thing):
            found.append((str(thing.__annotations__.get("return", "")), thing))
    return found
