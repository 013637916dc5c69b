"""Faults of a recording or an array, and how their places are written."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Mask

_MOST_LISTED = 8


class Fault(NamedTuple):
    """A fault that was found before any parameter of the device was fitted."""

    kind: str
    """Name, for example "dead row"."""
    text: str
    """Phrase with place and size."""

    def __str__(self) -> str:
        return self.text


def listed(places: Iterable[object]) -> str:
    """Return places as text; of many, the first ones and their number."""
    found = [str(each) for each in places]
    more = f" and {len(found) - _MOST_LISTED} more" if len(found) > _MOST_LISTED else ""
    return ", ".join(found[:_MOST_LISTED]) + more


def pixels_of(mask: Mask) -> str:
    """Return the places (row, column) of marked pixels as text."""
    places = [f"({row}, {column})" for row, column in np.argwhere(mask)]
    return f"{'pixel' if len(places) == 1 else 'pixels'} {listed(places)}"
