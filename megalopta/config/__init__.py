"""Configurations of a sequence, recipes of datasets, YAML."""

from pathlib import Path

_FOLDER = Path(__file__).parent / "presets"


def built_in_names() -> list[str]:
    """Names of the built-in configurations."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


def built_in_text(name: str) -> str:
    """YAML text of a built-in configuration; PRESETS in it is the folder of its files."""
    text = (_FOLDER / f"{name}.yaml").read_text("utf-8")
    return text.replace("PRESETS", _FOLDER.as_posix())
