"""The camera's clock by the host's, from when frames arrived.

A frame arrives after its time by a delay that is never negative, often small and sometimes long: a
USB hub, or the host, was busy. So host time against device time lies above a straight line and
touches it again and again. That line is the one below all arrivals with the smallest mean distance
to them, the edge of their lower convex hull over their mean time: no regression, which every burst
would draw upwards. The hull has O(log n) corners for n arrivals with random delays, so hours of
frames take no memory.

What delay the fastest frame had cannot be known: times are late by it, all alike.
"""

from itertools import pairwise
from typing import NamedTuple

LARGEST_DRIFT = 1e-3
"""No quartz is worse; steeper lines come of few arrivals."""
_MOST_CORNERS = 1024


class ClockFit(NamedTuple):
    """Host time = offset_s + rate · device time.

    Attributes
    ----------
    offset_s : float
        Host time at device time 0, s.
    rate : float
        Host seconds per device second.
    error_s : float or None
        Mean distance of the hull of arrivals from the line, s; None where it is not known.
    """

    offset_s: float
    rate: float
    error_s: float | None

    def host_s(self, device_us: int) -> float:
        """Host time, s."""
        return self.offset_s + self.rate * (device_us * 1e-6)


class Clock:
    """Fits one clock to another, arrival by arrival."""

    def __init__(self) -> None:
        self._corners: list[tuple[float, float]] = []
        self._arrivals = 0
        self._mean_s = 0.0

    def arrived(self, device_s: float, host_s: float) -> None:
        """Note an arrival, in the order of device times."""
        corners = self._corners
        if corners and device_s <= corners[-1][0]:
            return
        self._arrivals += 1
        self._mean_s += (device_s - self._mean_s) / self._arrivals
        while len(corners) > 1 and _is_above(corners[-1], corners[-2], (device_s, host_s)):
            corners.pop()
        corners.append((device_s, host_s))
        if len(corners) > _MOST_CORNERS:
            self._corners = _thinned(corners)

    @property
    def fit(self) -> ClockFit | None:
        """The line; None before the first arrival."""
        if not self._corners:
            return None
        rate = self._rate()
        offset_s = min(host - rate * device for device, host in self._corners)
        return ClockFit(offset_s, rate, self._mean_distance_s(offset_s, rate))

    def _rate(self) -> float:
        """Slope of the edge over the mean time, as far as a clock's can be."""
        for (device, host), (next_device, next_host) in pairwise(self._corners):
            if next_device >= self._mean_s:
                slope = (next_host - host) / (next_device - device)
                return min(max(slope, 1 - LARGEST_DRIFT), 1 + LARGEST_DRIFT)
        return 1.0

    def _mean_distance_s(self, offset_s: float, rate: float) -> float:
        heights = [(device, host - offset_s - rate * device) for device, host in self._corners]
        area = sum((b[0] - a[0]) * (a[1] + b[1]) / 2 for a, b in pairwise(heights))
        span_s = heights[-1][0] - heights[0][0]
        return area / span_s if span_s else 0.0


class KnownClock(Clock):
    """A clock that arrivals need not tell any more."""

    def __init__(self, known: ClockFit) -> None:
        super().__init__()
        self._known = known

    @property
    def fit(self) -> ClockFit:
        """The line."""
        return self._known


def _thinned(corners: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """At most half as many as allowed, evenly in time, with both ends."""
    apart_s = 2 * (corners[-1][0] - corners[0][0]) / _MOST_CORNERS
    kept = corners[:1]
    for corner in corners[1:-1]:
        if corner[0] - kept[-1][0] >= apart_s:
            kept.append(corner)
    return [*kept, corners[-1]]


def _is_above(
    middle: tuple[float, float], left: tuple[float, float], right: tuple[float, float]
) -> bool:
    """Return whether a point lies on or above the line between two others."""
    rise = (middle[1] - left[1]) * (right[0] - left[0])
    return rise >= (right[1] - left[1]) * (middle[0] - left[0])
