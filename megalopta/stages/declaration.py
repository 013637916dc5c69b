"""What a stage declares of itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from megalopta.config.model import Configuration
from megalopta.dataset.store import Dataset


@dataclass(frozen=True)
class Stage:
    """One step from scene to measurement.

    Attributes
    ----------
    name : str
        As the manifest has it.
    fields : tuple of str
        Parts of the configuration that its output depends on, beside those of the stages it needs.
    needs : tuple of str
        Stages that must be finished before.
    outputs : callable
        Files and folders of a dataset that it writes.
    work : callable
        Adds to a dataset what of the stage is not there yet.
    model : callable
        What of the program its output depends on (`freshness`).
    machinery : callable
        What of the machine its output depends on, by name: libraries, and what runs them.
    is_derived : bool
        Whether output of another model is made again without being asked.
    check : callable
        Refuses, with ValueError, a configuration that the stage cannot serve.
    verb : str
        Its words on the command line, where these are not its name.
    """

    name: str
    fields: tuple[str, ...]
    needs: tuple[str, ...]
    outputs: Callable[[Dataset], list[Path]]
    work: Callable[[Dataset], None]
    model: Callable[[], str]
    machinery: Callable[[Configuration], Mapping[str, str]] = lambda _: {}
    is_derived: bool = False
    check: Callable[[Configuration], None] = lambda _: None
    verb: str = ""

    @property
    def command(self) -> str:
        """What runs it, after `megalopta`."""
        return self.verb or self.name
