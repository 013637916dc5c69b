"""Figures 2.14 to 2.17 from a recording: frames, responses and transients of one speed."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.motion_bench import (
    FRAMES,
    OPEN_PHOTONS,
    TIME_CONSTANTS_S,
    UNITS,
    BenchLight,
    crossing_peaks,
    detector,
    pooled,
)
from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Figure
from megalopta.reproduction.chapter2_captured_bench import (
    ERRORS,
    HEADS,
    RecordedBench,
    numbered,
)
from megalopta.reproduction.chapter2_edge import (
    SHOWN_DETECTOR,
    frame_maps,
    responses,
    transient_panels,
    transients,
)

_ROWS = 16
_AT_EACH_END = FRAMES // 4
"""Frames of a passage before the edge comes, and after it."""


def frames_figure(bench: RecordedBench, light: BenchLight | None) -> Figure:
    """Figure 2.14; the light is that of the simulation, by default the dissertation's."""

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
            f"{bench.passages}. {_lit(light)} {ERRORS}"
        ),
        printed=bench.printed(quantities, "counts"),
        printed_by=HEADS,
        **frame_maps(
            {name: rows[:FRAMES] for name, rows in bench.rows().items()},
            "Pixel",
            "Counts",
            one_scale=True,
        ),
    )


def responses_figure(bench: RecordedBench, name: str, method: str) -> Figure:
    """Figure 2.15 or 2.16."""
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
        title=f"{numbered(name)}, captured: {method} in the frames of Figure 2.14",
        caption=(
            "Each panel shows ten detectors with time constants of "
            f"{1e3 * TIME_CONSTANTS_S[method]:.0f} ms. The table has the mean of the largest "
            "responses of all detectors of the array to an edge, and that of their responses "
            f"before it comes, {bench.passages}. {ERRORS}"
        ),
        printed=bench.printed({"Edge": edge, "Baseline": baseline}, UNITS[method]),
        printed_by=HEADS,
        **frame_maps(shown, "Detector", f"Response ({UNITS[method]})", one_scale=True),
    )


def transients_figure(bench: RecordedBench) -> Figure:
    """Figure 2.17."""

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
            f"pixel and detector, {bench.passages}. {ERRORS}"
        ),
        printed=printed,
        printed_by=HEADS,
        **transient_panels({name: transients(rows) for name, rows in bench.rows().items()}),
    )


def _lit(light: BenchLight | None) -> str:
    if light is None:
        return (
            f"Simulated in the dissertation's light: an open pixel detects {OPEN_PHOTONS:g} "
            "photons per frame."
        )
    return f"Simulated in the light of this recording, in which {light}: both agree by that."


def _hiding(counts: NDArray[Any]) -> NDArray[Any]:
    """Frames (passages, FRAMES, 16, 16) around the edges that hide."""
    return counts.reshape(-1, 2, FRAMES, *counts.shape[1:])[:, 0]
