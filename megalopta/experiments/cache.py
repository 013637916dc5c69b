"""Where results live that are costly to make and may be thrown away: the user's cache folder."""

from pathlib import Path

from platformdirs import user_cache_path


def cache_folder(chosen: Path | None = None) -> Path:
    """Folder chosen, else `megalopta` where this system keeps caches, on Linux ~/.cache."""
    return chosen or user_cache_path("megalopta", appauthor=False)
