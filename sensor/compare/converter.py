"""Faults of the ADC, from the codes of all pixels against the expected ones.

    stuck bit        0 or 1 in every code, although expected to be both
    missing codes    hardly seen between two frequent codes
    uneven codes     even codes more frequent than odd ones, or less

A comb of counts is smoother than one code only if read noise exceeds half a code; therefore the
expected recording, with the same comb, must not show the same.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.compare.faults import Fault, listed

_RARE = 0.01
"""Share of readings with a bit at its other value, above which both values are expected."""
_FREQUENT = 100
_MISSING = 0.05
_UNEVEN_Z = 8.0
_SMALLEST_UNEVENNESS = 0.05


class StuckBit(NamedTuple):
    """Bit of the ADC that does not change."""

    bit: int
    is_one: bool

    def on(self, codes: NDArray[Any]) -> NDArray[Any]:
        """Return codes as this ADC gives them."""
        mask = codes.dtype.type(1 << self.bit)
        return np.asarray(codes | mask if self.is_one else codes & ~mask)

    @property
    def fault(self) -> Fault:
        """Description of the fault."""
        text = f"bit {self.bit} of the ADC is stuck at {int(self.is_one)}"
        return Fault("stuck bit", text)


def stuck_bits(
    captured: Sequence[NDArray[Any]], expected: Sequence[NDArray[Any]]
) -> list[StuckBit]:
    """Find the bits that never change in captured codes (n, rows, columns)."""
    seen, known = _histogram(captured), _histogram(expected)
    size = max(seen.size, known.size)
    codes, found = np.arange(size), []
    for bit in range(int(size - 1).bit_length()):
        ones = [
            float(each[(codes[: each.size] >> bit) & 1 == 1].sum() / each.sum())
            for each in (seen, known)
        ]
        if ones[0] in (0.0, 1.0) and abs(ones[1] - ones[0]) > _RARE:
            found.append(StuckBit(bit, ones[0] == 1.0))
    return found


def uneven_codes(captured: Sequence[NDArray[Any]], expected: Sequence[NDArray[Any]]) -> list[Fault]:
    """Find missing and uneven codes."""
    seen, known = _histogram(captured), _histogram(expected)
    size = max(seen.size, known.size)
    seen, known = (np.pad(each, (0, size - each.size)) for each in (seen, known))
    middle, least, _ = _neighborhood(seen)
    middle_known, least_known, _ = _neighborhood(known)
    missing = (least > _FREQUENT) & (middle < _MISSING * least)
    missing &= middle_known > 0.3 * least_known
    if missing.any():
        text = f"the ADC lacks codes: {listed(np.flatnonzero(missing) + 1)}"
        return [Fault("missing codes", text)]
    (own, own_error), (other, other_error) = _parity(seen), _parity(known)
    share, error = own - other, float(np.hypot(own_error, other_error))
    if abs(share) > _UNEVEN_Z * error and abs(share) > _SMALLEST_UNEVENNESS:
        which = "even" if share > 0 else "odd"
        text = f"{which} codes of the ADC are {100 * abs(share):.2g} % wider than others"
        return [Fault("uneven codes", text)]
    return []


def _histogram(codes: Sequence[NDArray[Any]]) -> Floats:
    size = max(int(each.max(initial=0)) for each in codes) + 1
    return np.asarray(sum(np.bincount(each.ravel(), minlength=size) for each in codes), np.float64)


def _neighborhood(seen: Floats) -> tuple[Floats, Floats, Floats]:
    """Number of each code but the ends, the smaller number of its neighbors, and their mean."""
    left, right = seen[:-2], seen[2:]
    return seen[1:-1], np.minimum(left, right), (left + right) / 2


def _parity(seen: Floats) -> tuple[float, float]:
    """Mean relative excess of even codes over their neighbors, and its standard error."""
    middle, least, mean = _neighborhood(seen)
    used = (least > _FREQUENT) & (middle > _FREQUENT)
    if used.sum() < 32:
        return 0.0, np.inf
    even = np.where(np.arange(1, seen.size - 1) % 2 == 0, 1.0, -1.0)[used]
    excess = even * np.log(middle[used] / mean[used])
    return float(excess.mean()), float(excess.std(ddof=1) / np.sqrt(excess.size))
