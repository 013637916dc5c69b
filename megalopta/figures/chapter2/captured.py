"""Figures 2.14 to 2.19 from what a camera recorded of the plate, beside those simulated directly.

Both go through the same pooling, detectors and statistics. Numbers are means over the passages of
an edge with their standard errors; differences, captured less simulated, have the root of the sum
of their squares, and in parentheses how many of them a difference is.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from megalopta.arrays import Floats
from megalopta.experiments import (
    FRAMES,
    OPEN_PHOTONS,
    TIME_CONSTANTS_S,
    UNITS,
    BenchLight,
    Peaks,
    crossing_peaks,
    detector,
    peaks,
    pixels_per_frame,
    pooled,
    record,
)
from megalopta.figures import BLACK, GRAY, Figure
from megalopta.figures.chapter2.edge import (
    SHOWN_DETECTOR,
    frame_maps,
    responses,
    transient_panels,
    transients,
)
from megalopta.figures.chapter2.estimate import Estimate, jackknifed
from megalopta.figures.chapter2.transfer import (
    draw_peaks,
    statistics_columns,
    theory,
    theory_scale,
)
from megalopta.sensor import Sensor

_SIMULATED, _CAPTURED = "Simulated", "Captured"
_HEADS = (_CAPTURED, "Less simulated")
_ROWS = 16
_AT_EACH_END = FRAMES // 4
"""Frames of a passage before the edge comes, and after it."""


class _Bench(NamedTuple):
    """Frames (passages · 2·FRAMES, 16, 16) of one speed, simulated and captured."""

    speed_mm_s: float
    counts: Mapping[str, NDArray[Any]]

    @property
    def moves(self) -> str:
        speed = f"{self.speed_mm_s:g} mm/s"
        return f"{speed}, {pixels_per_frame(self.speed_mm_s):.2f} px per frame"

    def rows(self) -> dict[str, Floats]:
        """Pooled frames (2·FRAMES, 12) of the first row in the first passage."""
        return {name: pooled(counts)[:, 0] for name, counts in self.counts.items()}

    def printed(self, what: Mapping[str, Callable[[NDArray[Any]], Floats]], unit: str) -> Any:
        """What is a number of each passage, by name, as a table."""
        table = {}
        for name, of_passages in what.items():
            found = {each: Estimate.of(of_passages(self.counts[each])) for each in self.counts}
            table[name] = compared(found[_CAPTURED], found[_SIMULATED], unit)
        return table


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
    slow = _Bench(slowest, {_SIMULATED: simulated, _CAPTURED: captured[slowest]})
    yield _frames(slow, light)
    yield _responses(slow, "fig-2.15", "NDM")
    yield _responses(slow, "fig-2.16", "NDS")
    yield _transients(slow)
    direct = [peaks(speed, sensor, light) for speed in speeds]
    for name, method in (("fig-2.18", "NDM"), ("fig-2.19", "NDS")):
        ours = [each[method] for each in direct]
        theirs = [
            Peaks(crossing_peaks(detector(method), pooled(captured[speed])), same.ideal)
            for speed, same in zip(speeds, ours, strict=True)
        ]
        yield _transfer(name, method, speeds, {_SIMULATED: ours, _CAPTURED: theirs})


def compared(captured: Estimate, simulated: Estimate, unit: str) -> tuple[str, str]:
    """A number captured, and by how much it differs."""
    return f"{captured} {unit}", (captured - simulated).as_difference()


def _frames(bench: _Bench, light: BenchLight | None) -> Figure:
    def at(frames: slice) -> Callable[[NDArray[Any]], Floats]:
        return lambda counts: _hiding(counts)[:, frames].mean(axis=(1, 2, 3))

    quantities = {
        "Open pixel": at(slice(_AT_EACH_END)),
        "Hidden pixel": at(slice(-_AT_EACH_END, None)),
    }
    return Figure(
        name="fig-2.14",
        title="Figure 2.14, captured: 32 frames of a row of pooled pixels as an edge passes",
        caption=(
            f"The edge moves by {bench.moves}. Counts are those of the array, dark counts "
            f"included, in the {_AT_EACH_END} frames before and after the edge, "
            f"{_passages(bench.counts)}. {_lit(light)} {_ERRORS}"
        ),
        printed=bench.printed(quantities, "counts"),
        printed_by=_HEADS,
        **frame_maps(
            {name: rows[:FRAMES] for name, rows in bench.rows().items()}, "Pixel", "Counts"
        ),
    )


def _responses(bench: _Bench, name: str, method: str) -> Figure:
    memory = detector(method).memory_frames

    def edge(counts: NDArray[Any]) -> Floats:
        peaks = crossing_peaks(detector(method), pooled(counts))
        return np.asarray(peaks.mean(axis=(1, 2)))

    def baseline(counts: NDArray[Any]) -> Floats:
        answers = detector(method).respond(pooled(counts))[memory:_AT_EACH_END, :, 1:-1]
        return np.asarray(answers.reshape(len(answers), -1, _ROWS, 10).mean(axis=(0, 2, 3)))

    shown = {label: responses(method, rows[:FRAMES]) for label, rows in bench.rows().items()}
    return Figure(
        name=name,
        title=f"{_numbered(name)}, captured: {method} in the frames of Figure 2.14",
        caption=(
            "Each panel shows ten detectors with time constants of "
            f"{1e3 * TIME_CONSTANTS_S[method]:.0f} ms. The table has the mean of the largest "
            "responses of all detectors of the array to an edge, and that of their responses "
            f"before it comes, {_passages(bench.counts)}. {_ERRORS}"
        ),
        printed=bench.printed({"Edge": edge, "Baseline": baseline}, UNITS[method]),
        printed_by=_HEADS,
        **frame_maps(shown, "Detector", f"Response ({UNITS[method]})"),
    )


def _transients(bench: _Bench) -> Figure:
    def swing(counts: NDArray[Any]) -> Floats:
        pixel = pooled(counts)[:FRAMES].reshape(FRAMES, -1, _ROWS, 12)[:, :, 0, SHOWN_DETECTOR + 1]
        return np.asarray(pixel[:_AT_EACH_END].mean(axis=0) - pixel[-_AT_EACH_END:].mean(axis=0))

    def largest(method: str) -> Callable[[NDArray[Any]], Floats]:
        def of(counts: NDArray[Any]) -> Floats:
            return crossing_peaks(detector(method), pooled(counts))[:, 0, SHOWN_DETECTOR]

        return of

    printed = bench.printed({"Pooled pixel, open less hidden": swing}, "counts")
    for method in TIME_CONSTANTS_S:
        printed |= bench.printed({f"{method}, largest response": largest(method)}, UNITS[method])
    return Figure(
        name="fig-2.17",
        title="Figure 2.17, captured: one pooled pixel and its detectors as an edge passes twice",
        caption=(
            f"The edge moves by {bench.moves}; every curve is divided by its largest value, and of "
            "the recording the time between two passages is left out. The table is for this "
            f"pixel and detector, {_passages(bench.counts)}. {_ERRORS}"
        ),
        printed=printed,
        printed_by=_HEADS,
        **transient_panels({name: transients(rows) for name, rows in bench.rows().items()}),
    )


def _transfer(
    name: str, method: str, speeds: Sequence[float], found: Mapping[str, Sequence[Peaks]]
) -> Figure:
    velocity = np.array([pixels_per_frame(speed) for speed in speeds])
    ideal = np.array([each.ideal.mean() for each in found[_SIMULATED]])
    estimates = {
        label: [Estimate.of(each.noisy.mean(axis=(1, 2))) for each in over_speeds]
        for label, over_speeds in found.items()
    }
    apart = [a - b for a, b in zip(estimates[_CAPTURED], estimates[_SIMULATED], strict=True)]
    moving = [place for place, speed in enumerate(speeds) if speed > 0]
    ratios = {
        label: Estimate.mean([jackknifed(_snr_db, over_speeds[each].noisy) for each in moving])
        for label, over_speeds in found.items()
    }
    mean = {label: Estimate.mean([each[k] for k in moving]) for label, each in estimates.items()}

    def draw(canvas: Canvas) -> None:
        above, below = canvas.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        snr_db = {label: each.value for label, each in ratios.items()}
        draw_peaks(above, method, velocity, ideal, found, snr_db)
        below.axhline(0, color=GRAY, lw=1)
        values, errors = zip(*apart, strict=True)
        below.errorbar(velocity, values, errors, fmt="o", color=BLACK, capsize=3, lw=1.4, ms=4)
        below.set(xlabel="Image velocity (pixels/frame)", ylabel="Difference")

    return Figure(
        name=name,
        title=f"{_numbered(name)}, captured: peak response of {method} over velocity",
        caption=(
            "Points are the mean and σ of the largest response of one detector while an edge "
            f"crosses; below them the difference of the means, captured less simulated, with its "
            f"standard error. {_ERRORS} Means are over all speeds but 0."
        ),
        printed={
            "Peak response": compared(mean[_CAPTURED], mean[_SIMULATED], UNITS[method]),
            "SNR": compared(ratios[_CAPTURED], ratios[_SIMULATED], "dB"),
            "Largest difference of a speed": (
                f"{max(abs(each.errors_off) for each in apart):.1f} standard errors",
                f"of {len(speeds)} speeds",
            ),
        },
        printed_by=_HEADS,
        draw=draw,
        numbers={
            "speed_mm_s": np.array(speeds, float),
            "velocity_px_per_frame": velocity,
            "theoretical": theory_scale(method, velocity, ideal) * theory(method, velocity),
            "without_noise": ideal,
            **statistics_columns(found),
            "difference": np.array([each.value for each in apart]),
            "difference_error": np.array([each.error for each in apart]),
        },
        height_in=5.0,
    )


_ERRORS = "Errors are standard errors; in parentheses, how many of them a difference is."


def _lit(light: BenchLight | None) -> str:
    if light is None:
        return (
            f"Simulated in the dissertation's light: an open pixel detects {OPEN_PHOTONS:g} "
            "photons per frame."
        )
    return f"Simulated in the light of this recording, in which {light}: both agree by that."


def _passages(counts: Mapping[str, NDArray[Any]]) -> str:
    simulated, captured = (len(counts[name]) // (2 * FRAMES) for name in (_SIMULATED, _CAPTURED))
    return f"over {captured} passages captured and {simulated} simulated"


def _numbered(name: str) -> str:
    return f"Figure {name.removeprefix('fig-')}"


def _hiding(counts: NDArray[Any]) -> NDArray[Any]:
    """Frames (passages, FRAMES, 16, 16) around the edges that hide."""
    return counts.reshape(-1, 2, FRAMES, *counts.shape[1:])[:, 0]


def _snr_db(noisy: Floats) -> float:
    return Peaks(noisy, noisy).snr_db
