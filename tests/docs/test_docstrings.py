"""Every public name has a docstring in NumPy's form, which numpydoc's own rules hold.

Left out of these are sections that say nothing where the signature and a sentence say it all:
types (annotations), parameters and returns that need no word, further summaries, See Also. Units
need no capital letter. Examples are the pages and the gallery.
"""

import ast
import importlib
import inspect
import re
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LEFT_OUT = {
    "ES01",  # extended summary
    "EX01",  # examples
    "PR01",  # parameters without a word
    "PR04",  # types: they are annotated
    "PR07",  # parameters of which the type says all
    "PR08",  # a capital letter, of a unit too
    "RT01",  # returns
    "RT03",  # returns of which shape and unit say all
    "RT04",  # a capital letter, of a unit too
    "SA01",  # see also
    "SS05",  # "Counts of …" is no verb
    "YD01",  # yields
}
ERRORS = {"UserError", "ValueError"}


def room(stub):
    parts = stub.parent.relative_to(ROOT).parts
    return ".".join(parts if parts[0] == "megalopta" else ("megalopta", *parts))


ROOMS = sorted(
    room(stub)
    for folder in ("assets_gen", "flow", "megalopta", "render", "scenes", "sensor")
    for stub in (ROOT / folder).rglob("__init__.pyi")
)


def public(name):
    """Classes and functions that a package publishes, by the module that defines them."""
    module = importlib.import_module(name)
    things = (getattr(module, each) for each in module.__all__)
    for thing in things:
        is_ours = getattr(thing, "__module__", "").startswith("megalopta")
        if is_ours and (inspect.isclass(thing) or inspect.isfunction(thing)):
            yield f"{thing.__module__}.{thing.__qualname__}", thing


def raised(function):
    """Errors of users that a function raises itself."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    calls = [node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise)]
    names = {each.func.id for each in calls if isinstance(each, ast.Call) and is_name(each.func)}
    return names & ERRORS


def is_name(node):
    return isinstance(node, ast.Name)


@pytest.mark.parametrize("name", ROOMS)
def test_docstrings_are_as_numpydoc_wants_them(name):
    validate = pytest.importorskip("numpydoc.validate").validate
    wrong = [
        f"{full}: {text}"
        for full, _ in public(name)
        for code, text in validate(full)["errors"]
        if code not in LEFT_OUT
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", ROOMS)
def test_docstrings_tell_of_errors(name):
    silent = [
        full
        for full, thing in public(name)
        if inspect.isfunction(thing)
        and raised(thing)
        and not any(word in thing.__doc__ for word in ("Raise", "refuse", "Refuse"))
    ]
    assert not silent, "\n".join(silent)


ARRAY = re.compile(r"\b(?:ndarray|ArrayLike|_SupportsArray)\b")
# A shape in letters or numbers, or words for it; of a callable and a mapping the type says enough.
SHAPE = re.compile(
    r"\((?:\.\.\.|…|\w|\d+|side|n ≤ chunk|\w+s|2·\w+|count)(?: ?[−+·] ?\w+)*,|\bshapes?\b|[Ss]calars?\b"
)
HIDES_ARRAYS = re.compile(r"Callable\[|Mapping\[")


@pytest.mark.parametrize("name", ROOMS)
def test_docstrings_tell_the_shapes_of_arrays(name):
    silent = [
        full
        for full, thing in public(name)
        if inspect.isfunction(thing)
        and any(is_array(str(each)) for each in thing.__annotations__.values())
        and not SHAPE.search(thing.__doc__)
    ]
    assert not silent, "\n".join(silent)


def is_array(annotation):
    return bool(ARRAY.search(annotation)) and not HIDES_ARRAYS.search(annotation)
