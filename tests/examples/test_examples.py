"""Examples run as they stand, and do not import what is not public."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))
DISSERTATION = sorted((EXAMPLES[0].parent / "dissertation").glob("*.py"))
LIBRARIES = {f"megalopta.{name}" for name in ("assets_gen", "flow", "render", "scenes", "sensor")}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_import_what_the_libraries_publish(path):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("megalopta"):
            assert node.module in LIBRARIES


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_end_with_a_finite_n_2b(path):
    done = subprocess.run([sys.executable, path], check=True, capture_output=True, text=True)
    assert "N_2b = None" not in done.stdout
    assert done.stdout.count("N_2b = ") == 3


@pytest.mark.slow
@pytest.mark.parametrize("path", DISSERTATION, ids=lambda path: path.stem)
def test_figures_of_the_dissertation_are_short_scripts_of_public_functions(path):
    text = path.read_text("utf-8")
    assert text.count("\n") <= 50
    for node in ast.walk(ast.parse(text)):
        names = [alias.name for alias in getattr(node, "names", ()) if hasattr(alias, "asname")]
        assert not any(name.startswith("_") for name in names)
    drawn = {**os.environ, "MPLBACKEND": "agg"}
    subprocess.run([sys.executable, "-W", "error", path], check=True, env=drawn)
