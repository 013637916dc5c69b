"""Compiled functions are kept on disk, and compiled again where what is kept cannot be read."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

from megalopta.core.compiling import compiled

SCRIPT = """
import sys
sys.path.insert(0, {folder!r})
from module import twice
print(twice(21), sum(twice.stats.cache_hits.values()))
"""
MODULE = """
from megalopta.core.compiling import compiled

@compiled
def twice(value):
    return 2 * value
"""


def run(folder: Path) -> str:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kept")}
    script = SCRIPT.format(folder=str(folder))
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout


def test_code_kept_by_another_version_is_compiled_again(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text(MODULE)
    assert run(tmp_path) == "42 0\n"
    (index,) = tmp_path.rglob("*.nbi")
    version = pickle.dumps(pickle.loads(index.read_bytes()))
    of_a_class_that_is_gone = b"cmegalopta.core.compiling\nGone\n."
    index.write_bytes(version + of_a_class_that_is_gone)
    assert run(tmp_path) == "42 0\n"
    assert run(tmp_path) == "42 1\n"


def test_compiled_code_divides_as_numpy_does() -> None:
    def inverse(value: float) -> float:
        return 1 / value

    assert compiled(inverse)(0.0) == float("inf")
