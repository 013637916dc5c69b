"""Figures 2.14 to 2.19 from what a camera recorded of the plate, beside those simulated directly.

Both go through the same pooling, detectors and statistics. Numbers are means over the passages of
an edge with their standard errors; differences, captured less simulated, have the root of the sum
of their squares, and in parentheses how many of them a difference is.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from numpy.typing import NDArray

from megalopta.camera.motion_bench import (
    BenchLight,
    Peaks,
    crossing_peaks,
    detector,
    peaks,
    pooled,
    record,
)
from megalopta.plotting.picture import Figure
from megalopta.reproduction.chapter2_captured_bench import CAPTURED, SIMULATED, RecordedBench
from megalopta.reproduction.chapter2_captured_edge import (
    frames_figure,
    responses_figure,
    transients_figure,
)
from megalopta.reproduction.chapter2_captured_transfer import transfer_figure
from megalopta.sensor import Sensor


def captured_figures(
    captured: Mapping[float, NDArray[Any]], sensor: Sensor, light: BenchLight | None = None
) -> Iterator[Figure]:
    """Make the figures, one after the other.

    Parameters
    ----------
    captured : mapping
        Frames (passages · 2·FRAMES, 16, 16), as `experiments.cut_passages` cuts them, by the
        plate's speed (mm/s), at least one of which is not 0.
    sensor : Sensor
        What simulates the other half; of the same exposure.
    light : BenchLight, optional
        In which it does; by default that of the dissertation.
    """
    speeds = sorted(captured)
    slowest = next(speed for speed in speeds if speed > 0)
    simulated = record(slowest, sensor, light).counts
    slow = RecordedBench(slowest, {SIMULATED: simulated, CAPTURED: captured[slowest]})
    yield frames_figure(slow, light)
    yield responses_figure(slow, "fig-2.15", "NDM")
    yield responses_figure(slow, "fig-2.16", "NDS")
    yield transients_figure(slow)
    direct = [peaks(speed, sensor, light) for speed in speeds]
    for name, method in (("fig-2.18", "NDM"), ("fig-2.19", "NDS")):
        ours = [each[method] for each in direct]
        theirs = [
            Peaks(crossing_peaks(detector(method), pooled(captured[speed])), same.ideal)
            for speed, same in zip(speeds, ours, strict=True)
        ]
        yield transfer_figure(name, method, speeds, {SIMULATED: ours, CAPTURED: theirs})
