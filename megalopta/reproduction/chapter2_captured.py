"""Numbers with their standard errors."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from megalopta.camera.comparison import captured_frames
from megalopta.camera.motion_bench import (
    FRAME_RATE_HZ,
    FRAMES,
    OPEN_PHOTONS,
    TIME_CONSTANTS_S,
    UNITS,
    BenchLight,
    Peaks,
    crossing_peaks,
    cut_passages,
    cut_rest,
    detector,
    fitted_light,
    peaks,
    pixels_per_frame,
    pooled,
    record,
)
from megalopta.camera.recorded import Source, read_recorded
from megalopta.camera.recording import Recording, open_recording
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import working
from megalopta.plotting.picture import Figure, write_figure
from megalopta.plotting.style import BLACK, GRAY
from megalopta.reproduction.chapter2_edge import (
    SHOWN_DETECTOR,
    OverSpeeds,
    frame_maps,
    responses,
    transient_panels,
    transients,
)
from megalopta.sensor import Sensor, changed, load_sensor


class WithError(NamedTuple):
    """A number and its standard error."""

    value: float
    error: float

    @classmethod
    def of(cls, samples: Floats) -> Self:
        """The mean of independent samples (n,)."""
        return cls(float(samples.mean()), float(samples.std(ddof=1) / np.sqrt(len(samples))))

    @classmethod
    def mean(cls, estimates: Sequence["WithError"]) -> Self:
        """The mean of independent estimates."""
        values, errors = np.array(estimates).T
        return cls(float(values.mean()), float(np.hypot.reduce(errors) / len(errors)))

    @property
    def errors_off(self) -> float:
        """Distance from 0 in standard errors."""
        return self.value / self.error

    def __sub__(self, other: "WithError") -> "WithError":
        """Return the difference of independent estimates."""
        return WithError(self.value - other.value, float(np.hypot(self.error, other.error)))

    def __str__(self) -> str:
        """Return both with the digits that the error leaves, two of its own."""
        digits = self._digits()
        return f"{self.value:.{digits}f} ± {self.error:.{digits}f}"

    def as_difference(self) -> str:
        """Return both with a sign, and how many errors it is from 0."""
        digits = self._digits()
        return f"{self.value:+.{digits}f} ± {self.error:.{digits}f} ({self.errors_off:+.1f})"

    def _digits(self) -> int:
        return max(0, 1 - int(np.floor(np.log10(self.error)))) if self.error > 0 else 2


def jackknifed(statistic: Callable[[Floats], float], samples: Floats) -> WithError:
    """A statistic of independent samples (n, …) with its error by the jackknife (Efron 1982)."""
    without = [statistic(np.delete(samples, left, axis=0)) for left in range(len(samples))]
    # Each has lost an n-th of the data, and with it (n − 1)/√n of a standard deviation of means.
    error = np.std(without) * np.sqrt(len(samples) - 1)
    return WithError(statistic(samples), float(error))


SIMULATED, CAPTURED = "Simulated", "Captured"
_HEADS = (CAPTURED, "Less simulated")
_ERRORS = "Errors are standard errors; in parentheses, how many of them a difference is."
_ROWS = 16
_AT_EACH_END = FRAMES // 4
"""Frames of a passage before the edge comes, and after it."""

OfPassages = Callable[[NDArray[Any]], Floats]
"""Frames (passages · 2·FRAMES, 16, 16) to a number of each passage"""


def captured_figures(
    captured: Mapping[float, NDArray[Any]], sensor: Sensor, light: BenchLight | None = None
) -> Iterator[Figure]:
    """Make the figures, one after the other.

    Parameters
    ----------
    captured : mapping
        Frames (passages · 2·FRAMES, 16, 16), as `cut_passages` cuts them, by the
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
    yield _frames(slow, light)
    yield _responses(slow, "2.15", "NDM")
    yield _responses(slow, "2.16", "NDS")
    yield _transients(slow)
    direct = [peaks(speed, sensor, light) for speed in speeds]
    for number, method in (("2.18", "NDM"), ("2.19", "NDS")):
        ours = [each[method] for each in direct]
        theirs = [
            Peaks(crossing_peaks(detector(method), pooled(captured[speed])), same.ideal)
            for speed, same in zip(speeds, ours, strict=True)
        ]
        found = {SIMULATED: ours, CAPTURED: theirs}
        yield _transfer(number, OverSpeeds(method, speeds, found))


class RecordedBench(NamedTuple):
    """Frames (passages · 2·FRAMES, 16, 16) of one speed, simulated and captured."""

    speed_mm_s: float
    counts: Mapping[str, NDArray[Any]]

    @property
    def moves(self) -> str:
        """Speed of the plate and of its image."""
        speed = f"{self.speed_mm_s:g} mm/s"
        return f"{speed}, {pixels_per_frame(self.speed_mm_s):.2f} px per frame"

    @property
    def passages(self) -> str:
        """Number of passages."""
        simulated, captured = (
            len(self.counts[name]) // (2 * FRAMES) for name in (SIMULATED, CAPTURED)
        )
        return f"over {captured} passages captured and {simulated} simulated"

    def rows(self) -> dict[str, Floats]:
        """Return pooled frames (2·FRAMES, 12) of the first row in the first passage."""
        return {name: pooled(counts)[:, 0] for name, counts in self.counts.items()}

    def printed(self, what: Mapping[str, OfPassages], unit: str) -> dict[str, tuple[str, str]]:
        """Return means over the passages of what is a number of each, by name."""
        table = {}
        for name, of_passages in what.items():
            found = {each: WithError.of(of_passages(self.counts[each])) for each in self.counts}
            table[name] = _compared(found[CAPTURED], found[SIMULATED], unit)
        return table


def _compared(captured: WithError, simulated: WithError, unit: str) -> tuple[str, str]:
    """Return a number captured, and by how much it differs."""
    return f"{captured} {unit}", (captured - simulated).as_difference()


def _frames(bench: RecordedBench, light: BenchLight | None) -> Figure:
    """Figure 2.14; the light is that of the simulation, by default the dissertation's."""
    ends = {"Open pixel": slice(_AT_EACH_END), "Hidden pixel": slice(-_AT_EACH_END, None)}
    what = {name: partial(_level, frames) for name, frames in ends.items()}
    return Figure(
        name="fig-2.14",
        title="Figure 2.14, captured: 32 frames of a row of pooled pixels as an edge passes",
        caption=(
            f"The edge moves by {bench.moves}. Counts are those of the array, dark counts "
            f"included, in the {_AT_EACH_END} frames before and after the edge, "
            f"{bench.passages}. {_lit(light)} {_ERRORS}"
        ),
        printed=bench.printed(what, "counts"),
        printed_by=_HEADS,
        **frame_maps(
            {name: rows[:FRAMES] for name, rows in bench.rows().items()},
            "Pixel",
            "Counts",
            one_scale=True,
        ),
    )


def _responses(bench: RecordedBench, number: str, method: str) -> Figure:
    """Figure 2.15 or 2.16."""
    shown = {label: responses(method, rows[:FRAMES]) for label, rows in bench.rows().items()}
    return Figure(
        name=f"fig-{number}",
        title=f"Figure {number}, captured: {method} in the frames of Figure 2.14",
        caption=(
            "Each panel shows ten detectors with time constants of "
            f"{1e3 * TIME_CONSTANTS_S[method]:.0f} ms. The table has the mean of the largest "
            "responses of all detectors of the array to an edge, and that of their responses "
            f"before it comes, {bench.passages}. {_ERRORS}"
        ),
        printed=bench.printed(
            {"Edge": partial(_edge, method), "Baseline": partial(_baseline, method)}, UNITS[method]
        ),
        printed_by=_HEADS,
        **frame_maps(shown, "Detector", f"Response ({UNITS[method]})", one_scale=True),
    )


def _transients(bench: RecordedBench) -> Figure:
    """Figure 2.17."""
    printed = bench.printed({"Pooled pixel, open less hidden": _swing}, "counts")
    for method in TIME_CONSTANTS_S:
        what = {f"{method}, largest response": partial(_largest, method)}
        printed |= bench.printed(what, UNITS[method])
    return Figure(
        name="fig-2.17",
        title="Figure 2.17, captured: one pooled pixel and its detectors as an edge passes twice",
        caption=(
            f"The edge moves by {bench.moves}; every curve is divided by its largest value, and of "
            "the recording the time between two passages is left out. The table is for this "
            f"pixel and detector, {bench.passages}. {_ERRORS}"
        ),
        printed=printed,
        printed_by=_HEADS,
        **transient_panels({name: transients(rows) for name, rows in bench.rows().items()}),
    )


def _level(frames: slice, counts: NDArray[Any]) -> Floats:
    """Return mean counts of the array in some frames around the edges that hide."""
    hiding = counts.reshape(-1, 2, FRAMES, *counts.shape[1:])[:, 0]
    return np.asarray(hiding[:, frames].mean(axis=(1, 2, 3)))


def _edge(method: str, counts: NDArray[Any]) -> Floats:
    """Return the mean over the array of the largest responses to an edge."""
    return np.asarray(crossing_peaks(detector(method), pooled(counts)).mean(axis=(1, 2)))


def _baseline(method: str, counts: NDArray[Any]) -> Floats:
    """Return mean responses before the edge comes."""
    one = detector(method)
    answers = one.respond(pooled(counts))[one.memory_frames : _AT_EACH_END, :, 1:-1]
    return np.asarray(answers.reshape(len(answers), -1, _ROWS, 10).mean(axis=(0, 2, 3)))


def _swing(counts: NDArray[Any]) -> Floats:
    """Return counts of one pooled pixel, open less hidden."""
    pixel = pooled(counts)[:FRAMES].reshape(FRAMES, -1, _ROWS, 12)[:, :, 0, SHOWN_DETECTOR + 1]
    return np.asarray(pixel[:_AT_EACH_END].mean(axis=0) - pixel[-_AT_EACH_END:].mean(axis=0))


def _largest(method: str, counts: NDArray[Any]) -> Floats:
    """Return the largest responses of one detector."""
    return crossing_peaks(detector(method), pooled(counts))[:, 0, SHOWN_DETECTOR]


def _lit(light: BenchLight | None) -> str:
    if light is None:
        return (
            f"Simulated in the dissertation's light: an open pixel detects {OPEN_PHOTONS:g} "
            "photons per frame."
        )
    return f"Simulated in the light of this recording, in which {light}: both agree by that."


def _transfer(number: str, measured: OverSpeeds) -> Figure:
    """Figure 2.18 or 2.19."""
    method, found, speeds = measured.method, measured.found, measured.speeds_mm_s
    means = {
        label: [WithError.of(each.noisy.mean(axis=(1, 2))) for each in own]
        for label, own in found.items()
    }
    apart = [a - b for a, b in zip(means[CAPTURED], means[SIMULATED], strict=True)]
    moving = [place for place, speed in enumerate(speeds) if speed > 0]
    ratios = {label: _ratio(own, moving) for label, own in found.items()}
    mean = {label: WithError.mean([own[k] for k in moving]) for label, own in means.items()}
    farthest = f"{max(abs(each.errors_off) for each in apart):.1f} errors"
    return Figure(
        name=f"fig-{number}",
        title=f"Figure {number}, captured: peak response of {method} over velocity",
        caption=_TRANSFER,
        printed={
            "Peak response": _compared(mean[CAPTURED], mean[SIMULATED], UNITS[method]),
            "SNR": _compared(ratios[CAPTURED], ratios[SIMULATED], "dB"),
            f"Largest difference of a speed, of {len(speeds)}": (farthest, ""),
        },
        printed_by=_HEADS,
        draw=partial(_draw_transfer, measured=measured, ratios=ratios, apart=apart),
        numbers=measured.columns() | _differences(apart),
        height_in=5.0,
    )


_TRANSFER = (
    "Points are the mean and σ of the largest response of one detector while an edge crosses; "
    "below them the difference of the means, captured less simulated, with its standard error. "
    f"{_ERRORS} Means are over all speeds but 0."
)


def _differences(apart: Sequence[WithError]) -> dict[str, Floats]:
    values, errors = np.array(apart).T
    return {"difference": values, "difference_error": errors}


def _draw_transfer(
    canvas: Canvas,
    measured: OverSpeeds,
    ratios: Mapping[str, WithError],
    apart: Sequence[WithError],
) -> None:
    above, below = canvas.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    measured.draw(above, {label: each.value for label, each in ratios.items()})
    below.axhline(0, color=GRAY, lw=1)
    values, errors = zip(*apart, strict=True)
    look = {"fmt": "o", "color": BLACK, "capsize": 3, "lw": 1.4, "ms": 4}
    below.errorbar(measured.velocity, values, errors, **look)
    below.set(xlabel="Image velocity (pixels/frame)", ylabel="Difference")


def _ratio(own: Sequence[Peaks], places: Sequence[int]) -> WithError:
    """Return the mean signal-to-noise ratio of some speeds, dB."""
    return WithError.mean([jackknifed(_snr_db, own[each].noisy) for each in places])


def _snr_db(noisy: Floats) -> float:
    return Peaks(noisy, noisy).snr_db


def reproduce_captured(
    sources: Sequence[Source], out: Path, device: Path | None = None, *, own_light: bool = False
) -> Iterator[Path]:
    """Draw figures 2.14 to 2.19 from recordings beside those simulated; yield their files' paths.

    Parameters
    ----------
    sources : sequence of Source
        Recordings of the plate, with its speed (mm/s) in place of the light; several of one speed
        are taken together.
    out : Path
        Made if it does not exist; files of the same name are replaced, each as a whole.
    device : Path, optional
        Device file that simulates, and whose steps turn codes into counts; by default the nominal
        sensor of the recordings, through the nominal step.
    own_light : bool
        Whether to simulate in the light that the recording of the slowest plate shows, instead of
        the dissertation's.

    Raises
    ------
    UserError
        When device or recordings cannot be read, or show no passages; nothing is written then.
    """
    if not any(source.light > 0 for source in sources):
        raise UserError(
            "figures: only a plate at rest; give recordings with its speed, such as a@5"
        )
    opened = [_opened(source.path) for source in sources]
    sensor = _sensor(opened, device)
    cut: dict[float, list[NDArray[Any]]] = {}
    for source, recording in zip(sources, opened, strict=True):
        counts = _counts_of(source, recording, sensor if device else None)
        cut.setdefault(source.light, []).append(_cut(source, recording, counts))
    captured = {speed: np.concatenate(parts) for speed, parts in cut.items()}
    light = None
    if own_light:
        slowest = min(speed for speed in captured if speed > 0)
        try:
            light = fitted_light(captured[slowest], sensor)
        except ValueError as problem:
            raise UserError(f"plate at {slowest:g} mm/s: {problem}") from problem
    ensure_directory(out)
    with working("figures"):
        for figure in captured_figures(captured, sensor, light):
            yield from write_figure(figure, out)


def _opened(path: Path) -> Recording:
    try:
        recording = open_recording(path)
    except (OSError, ValueError) as problem:
        raise UserError(str(problem)) from problem
    settings = recording.settings
    timing = settings.frame_rate_hz * np.array([1, settings.exposure_s])
    if not np.allclose(timing, (FRAME_RATE_HZ, 1), rtol=0.01):
        raise UserError(
            f"{path}: {settings.frame_rate_hz:g} frames/s of {settings.exposure_s:g} s; capture "
            f"with --rate {FRAME_RATE_HZ:g} --exposure {1 / FRAME_RATE_HZ:g}"
        )
    return recording


def _sensor(opened: Sequence[Recording], device: Path | None) -> Sensor:
    first, *others = opened
    for other in others:
        if other.sensor != first.sensor:
            raise UserError(
                f"{other.path}: another sensor or step than in {first.path}; give recordings with "
                "the same settings"
            )
    if device is None:
        return changed(first.sensor, counter={"calibrated": False})
    try:
        return changed(load_sensor(device), exposure_s=first.exposure_s)
    except (OSError, ValueError) as problem:
        raise UserError(f"--device: {problem}") from problem


def _counts_of(source: Source, recording: Recording, device: Sensor | None) -> NDArray[Any]:
    if device is None:
        return np.asarray(recording.counts[:])
    return captured_frames(read_recorded(source), device, 0.0).counts


def _cut(source: Source, recording: Recording, counts: NDArray[Any]) -> NDArray[Any]:
    try:
        if source.light:
            return cut_passages(counts, recording.sequence_number)
        return cut_rest(counts)
    except ValueError as problem:
        raise UserError(f"{source.path}: {problem}") from problem
