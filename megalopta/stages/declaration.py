"""What a stage declares of itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from megalopta.config.model import Configuration
from megalopta.dataset.store import Dataset


@dataclass(frozen=True)
class Stage:
    """One step from scene to measurement."""

    name: str
    command: str
    """What runs it, after `megalopta`"""
    fields: tuple[str, ...]
    """Parts of the configuration that its output depends on, beside those of the stages it needs"""
    needs: tuple[str, ...]
    """Stages that must be finished before"""
    outputs: Callable[[Dataset], list[Path]]
    """Files and folders of a dataset that it writes"""
    work: Callable[[Dataset], None]
    """Adds to a dataset what of the stage is not there yet"""
    model: Callable[[], str]
    """What of the program its output depends on (`freshness`)"""
    machinery: Callable[[Configuration], Mapping[str, str]] = lambda _: {}
    """What of the machine its output depends on, by name: libraries, and what runs them"""
    is_derived: bool = False
    """Whether output of another model is made again without being asked"""
    check: Callable[[Configuration], None] = lambda _: None
    """Refuses, with ValueError, a configuration that the stage cannot serve"""
