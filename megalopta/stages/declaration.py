"""Declaration of a stage."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from megalopta.config.model import Configuration
from megalopta.dataset.store import Dataset


@dataclass(frozen=True)
class Stage:
    """One step from scene to measurement."""

    name: str
    command: str
    """Its command, after `megalopta`"""
    fields: tuple[str, ...]
    """Parts of the configuration that its output depends on, other than those of stages it needs"""
    needs: tuple[str, ...]
    """Stages that must be finished first"""
    outputs: Callable[[Dataset], list[Path]]
    """Files and folders of a dataset that it writes"""
    work: Callable[[Dataset], None]
    """Adds missing output to a dataset"""
    made_with: Callable[[Configuration], dict[str, str]]
    """Model of the program (`freshness`), libraries and back ends that its output depends on"""
    is_derived: bool = False
    """True if output of another model is recomputed without request"""
    check: Callable[[Configuration], object] = lambda _: None
    """Refuses, with ValueError, an unsuitable configuration"""
    rehearse: Callable[[Configuration], object] = lambda _: None
    """The same by more work, before old output is removed"""
