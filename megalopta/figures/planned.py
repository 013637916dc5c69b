"""A figure that rests on trials of the flow benchmark."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from megalopta.experiments import Array, Results, Template, Trial
from megalopta.figures.figure import Figure

Templates: TypeAlias = Mapping[Template, Array]


@dataclass(frozen=True)
class Planned:
    """A figure whose trials are known before they are run, so that figures share them."""

    trials: Callable[[bool], Sequence[Trial]]
    """Whether in quick form, to the trials"""

    figure: Callable[[bool, Results, Templates], Figure]
    """Whether in quick form, the results of the trials and the pixels of their templates"""


PlannedRegistry: TypeAlias = Mapping[str, Planned]
"""Name of a figure to its plan."""
