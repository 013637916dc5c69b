"""The packages: who may import whom, and through which door."""

import ast
import runpy
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from itertools import pairwise
from pathlib import Path

import pytest
import setuptools

ROOT = Path(__file__).parents[1]
FOLDERS = ("assets_gen", "flow", "render", "scenes", "sensor")
SHARED = "core"
"""The package of the program that the libraries import, too."""
SHOWING = "report"
"""Others build their pages with its builder, and it shows theirs: its modules count singly."""


def sources() -> list[Path]:
    return sorted(
        path for folder in (*FOLDERS, "megalopta") for path in (ROOT / folder).rglob("*.py")
    )


def module_of(path: Path) -> str:
    """Dotted name below megalopta, such as "sensor.spad.model"; of a package, its own."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[1:] if parts[0] == "megalopta" else parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path) for path in sources() if path.name != "__init__.py"}
PACKAGES = {module_of(path) for path in sources() if path.name == "__init__.py"}


def room_of(module: str) -> str:
    """The package that a module lies in; a package is its own room."""
    return module if module in PACKAGES else module.rpartition(".")[0]


def place_of(module: str) -> str:
    """The room of a module, or the module itself where it stands beside rooms."""
    room = room_of(module)
    if room == SHOWING:
        return module
    has_rooms = any(package.rpartition(".")[0] == room for package in PACKAGES)
    return module if has_rooms else room


@cache
def imports(path: Path) -> list[tuple[str, str]]:
    """Module, below megalopta, and name of everything that a file imports of us."""
    return [
        (str(node.module).removeprefix("megalopta").removeprefix("."), alias.name)
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "megalopta"
        for alias in node.names
    ]


def published(package: str) -> dict[str, str]:
    """What a package publishes: every name to the module it comes from."""
    folder = ROOT / package.replace(".", "/")
    if package.split(".")[0] not in FOLDERS:
        folder = ROOT / "megalopta" / package.replace(".", "/")
    stub = folder / "__init__.pyi"
    if not stub.exists():
        return {}
    return {
        alias.name: f"{package}.{node.module}" if node.module else f"{package}.{alias.name}"
        for node in ast.parse(stub.read_text("utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def places_imported(path: Path) -> Iterator[str]:
    for module, name in imports(path):
        full = f"{module}.{name}".lstrip(".")
        if full in MODULES | PACKAGES:
            yield place_of(full)
        elif module:
            yield place_of(published(module).get(name, module))


def test_arrows_between_rooms_point_one_way():
    graph: dict[str, set[str]] = {}
    for path in sources():
        if path.name != "__init__.py":
            own = place_of(module_of(path))
            graph.setdefault(own, set()).update(set(places_imported(path)) - {own})
    list(TopologicalSorter(graph).static_order())  # raises CycleError, which names the circle


def test_libraries_import_nothing_of_the_program_but_its_core():
    for path in sources():
        folder = module_of(path).split(".")[0]
        if folder not in FOLDERS:
            continue
        for module, name in imports(path):
            first = (module or name).split(".")[0]
            assert first in (*FOLDERS, SHARED), f"{path}: imports megalopta.{module} {name}"


def test_private_names_stay_in_their_module():
    for path in (*sources(), *(ROOT / "tests").rglob("*.py")):
        for module, name in imports(path) if path.name != "__main__.py" else ():
            assert not private(name), f"{path}: {name} is private to {module}"


def test_what_a_room_publishes_is_there():
    import importlib

    for package in PACKAGES - {""}:
        module = importlib.import_module(f"megalopta.{package}")
        for name in published(package):
            assert hasattr(module, name), f"megalopta.{package} has no {name}"


def test_every_room_is_packaged(monkeypatch):
    told: dict[str, object] = {}
    monkeypatch.setattr(setuptools, "setup", told.update)
    monkeypatch.chdir(ROOT)
    runpy.run_path("setup.py")
    assert set(told["packages"]) == {f"megalopta.{package}".rstrip(".") for package in PACKAGES}
    assert told["package_dir"] == {f"megalopta.{folder}": folder for folder in FOLDERS}


def modules_in(tree: ast.Module) -> set[str]:
    """Names by which a file calls modules and packages of ours."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "megalopta":
            above = str(node.module).removeprefix("megalopta").lstrip(".")
            for alias in node.names:
                if f"{above}.{alias.name}".lstrip(".") in MODULES | PACKAGES:
                    found.add(alias.asname or alias.name)
    return found


def private_names_used(tree: ast.Module) -> Iterator[str]:
    """Yield private names of ours that a file takes from a module, or puts into one by a string."""
    ours = modules_in(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id in ours and private(node.attr):
                yield node.attr
        elif isinstance(node, (ast.Call, ast.Tuple)):
            # setattr(module, "name", …) and rows (module, "name", …) of a table for it
            parts = node.args if isinstance(node, ast.Call) else node.elts
            for owner, name in pairwise(parts):
                is_ours = isinstance(owner, ast.Name) and owner.id in ours
                if is_ours and isinstance(name, ast.Constant) and private(str(name.value)):
                    yield str(name.value)
        elif isinstance(node, ast.Constant) and str(node.value).startswith("megalopta."):
            yield from filter(private, str(node.value).split("."))


def test_tests_use_no_private_names():
    for path in (ROOT / "tests").rglob("*.py"):
        assert not list(private_names_used(ast.parse(path.read_text("utf-8")))), path


@pytest.mark.parametrize(
    ("folders", "most"),
    [((*FOLDERS, "megalopta", "examples"), 63_261), (("tests",), 32_607)],
    ids=["sources", "tests"],
)
def test_a_new_line_is_paid_by_an_old_one(folders, most):
    """The limits are what the house has reached: they only ever go down."""
    files = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    lines = sum(path.read_text("utf-8").count("\n") for path in files)
    assert lines <= most, f"{lines} lines: delete or simplify as many as you add"
