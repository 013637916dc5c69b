"""How a figure is made. A module in one of the folders here lists its recipes in RECIPES."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

from megalopta.benchmark.runner import Results
from megalopta.benchmark.templates import Template
from megalopta.benchmark.trial import Trial
from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Figure

Templates: TypeAlias = Mapping[Template, Floats]


@dataclass(frozen=True)
class Run:
    """What figures are made from, the same for all that are asked for at once."""

    is_quick: bool = False
    results: Results = field(default_factory=dict)
    """Of the trials of all of them"""

    templates: Templates = field(default_factory=dict)
    """The pixels of the trials' templates"""

    cache: Path | None = None
    """Folder of rendered panoramas; by default the user's"""


@dataclass(frozen=True)
class FigureRecipe:
    """A figure under its name, with the trials of the flow benchmark that it rests on.

    These are known before they are run, so that figures share them.
    """

    name: str
    """As on the command line and in file names"""

    figure: Callable[[Run], Figure]
    trials: Callable[[bool], Sequence[Trial]] = lambda is_quick: ()
    """Whether in quick form, to the trials"""

    page: Callable[[Path, Sequence[Figure]], Path] | None = None
    """Writes a page into a folder, about all figures drawn there"""

    def make(self, run: Run) -> Figure:
        """Return the figure; one that rests on fewer trials says so, in title and numbers."""
        made = replace(self.figure(run), name=self.name)
        if not (run.is_quick and self.trials(True)):
            return made
        title = f"{made.title} (quick form)"
        return replace(made, title=title, details={**made.details, "quick": True})
