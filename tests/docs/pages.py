"""Pages of the documentation as what a reader does with them: blocks, in their order."""

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(
    page
    for page in DOCS.rglob("*.md")
    if not {"generated", "example_device", "public_arrays"} & set(page.relative_to(DOCS).parts)
)
REPOSITORY_PAGES = [DOCS.parent / f"{name}.md" for name in ("README", "CONTRIBUTING", "CHANGELOG")]
_BLOCK = re.compile(
    r"^```(?:\{code-block\} )?(?P<language>\w+)\n(?::caption: (?P<file>\S+)\n+)?(?P<text>.*?)^```",
    re.DOTALL | re.MULTILINE,
)
_TIMEOUT_S = 600


@dataclass(frozen=True)
class Block:
    """A block of code; one with a caption is a file that the reader writes."""

    language: str
    text: str
    file: str | None


def blocks(page: Path) -> list[Block]:
    """Blocks of a page that a reader runs or writes."""
    found = (
        Block(each["language"], each["text"], each["file"])
        for each in _BLOCK.finditer(page.read_text("utf-8"))
    )
    return [each for each in found if each.file or each.language in ("python", "sh")]


def run(block: Block, folder: Path, names: dict[str, object]) -> None:
    """Do what a block says, in a folder; `names` are what earlier blocks of Python defined."""
    if block.file:
        (folder / block.file).write_text(block.text, "utf-8")
    elif block.language == "python":
        exec(compile(block.text, "page", "exec"), names)
    else:
        beside = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        subprocess.run(
            ["bash", "-euo", "pipefail", "-c", block.text],
            cwd=folder,
            env={**os.environ, "PATH": beside},
            check=True,
            timeout=_TIMEOUT_S,
        )
