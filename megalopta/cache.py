"""Where results live that are costly to make and may be thrown away: the user's cache folder."""

import os
from pathlib import Path


def cache_folder(chosen: Path | None = None) -> Path:
    """Folder chosen, else `megalopta` in XDG_CACHE_HOME, which is ~/.cache if not set."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return chosen or Path(home) / "megalopta"
