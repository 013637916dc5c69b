"""The motion bench of §2.4.8: a plate's edge crosses SPADCAM and returns, simulated or recorded.

The bench scene is rendered for one row of 16 pixels and exposed by a sensor of 16 such rows; the
dissertation measures one row of its device. Frames follow each other at 10 per second without gaps.
Open pixels detect 65 photons per frame, on average over the pixels, hidden ones 27, besides dark
counts. Rows are pooled from 16 to 12 pixels and pass through NDM and NDS without a low-pass at the
output, which the dissertation does not mention here. The response of a detector to an edge is its
largest value during one crossing, 32 frames at every speed.

A recording begins at any time, and the plate rests at its ends for any time. The mean count of the
array falls while an edge hides it and rises while one uncovers it; at the halfway value, the edge
is in the middle. Each passage is cut like simulated ones: 32 frames around the hiding edge, then 32
around the next uncovering edge.
"""

import math
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.flow import Detector, triangular_pool
from megalopta.flow.detectors import correlation
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.light import Light
from megalopta.scenes.stimuli.grating import sky_radiance
from megalopta.scenes.stimuli.plane import MotionBench
from megalopta.scenes.trajectories.steady import Trajectory
from megalopta.sensor import Exposure, Sensor, detection_rate, expose, preset
from megalopta.sensor.expectations import expectation

FRAME_RATE_HZ = 10.0
FRAMES = 32
"""Frames of one crossing; a recording has two crossings."""
PIXELS = 16
OPEN_PHOTONS = 65.0
SPEEDS_MM_S = tuple(float(speed) for speed in range(11))
TIME_CONSTANTS_S = {"NDM": 60e-3, "NDS": 40e-3}
UNITS = {"NDM": "counts²", "NDS": "counts"}
"""Units of the responses."""
SENSORS = {"Poisson noise only": preset("ideal"), "SPADCAM": preset("spadcam")}

_CAMERA = PerspectiveCamera(width=PIXELS, height=1, fov_deg=20)
_BANDS_NM = ((690.0, 710.0),)
_LUX = 1.0
_ROWS = 16
_PHASES = 4
"""Positions of the edge at a frame, as equal parts of its motion per frame."""


class Peaks(NamedTuple):
    """Peak responses at one speed."""

    noisy: Floats
    """(crossings, rows, detectors): in counts (NDS) or counts² (NDM)."""
    ideal: Floats
    """The same without noise, of fewer crossings."""

    @property
    def mean(self) -> float:
        """Mean over crossings, rows and detectors."""
        return float(self.noisy.mean())

    @property
    def deviation(self) -> float:
        """Standard deviation of one detector over crossings; RMS over the array."""
        return float(np.sqrt(self.noisy.var(axis=0, ddof=1).mean()))

    @property
    def snr_db(self) -> float:
        """20·log10 of mean over standard deviation of one detector."""
        return float(20 * np.log10(self.mean / self.deviation))


def pixels_per_frame(speed_mm_s: float) -> float:
    """Motion of the image in one frame (px)."""
    return speed_mm_s * 1e3 / (MotionBench().pixel_pitch_um * FRAME_RATE_HZ)


def filter_step(name: str) -> float:
    """Step a of both filters of NDM or NDS."""
    return 1 / (1 + TIME_CONSTANTS_S[name] * FRAME_RATE_HZ)


def detector(name: str) -> Detector:
    """NDM or NDS with the bench's time constant."""
    step = filter_step(name)
    if name == "NDM":
        return correlation.NonDirectionalMultiplication(filter_step=step, output_step=1)
    return correlation.NonDirectionalSummation(filter_step=step, output_step=1)


@cache
def stimulus(speed_mm_s: float) -> Floats:
    """Radiance (phases, 2·FRAMES, 1, 16, 1) of recordings at one speed, W·m⁻²·sr⁻¹·nm⁻¹.

    Halfway through a crossing the edge is in the middle.
    """
    # Mitsuba takes a second to load, and other figures do not need it.
    from megalopta.render import RenderSettings, SceneRenderer, frame_seed

    # As many instants per frame as pixels passed give a smooth blur.
    per_frame = _PHASES * max(1, math.ceil(pixels_per_frame(speed_mm_s) / _PHASES))
    path = Trajectory(
        frames=(FRAMES + 1) * per_frame, frame_rate_hz=FRAME_RATE_HZ * per_frame,
        position_m=(0, 0, 0), look_at_m=(1, 0, 0), velocity_m_s=(0, -1e-3 * speed_mm_s, 0),
    )  # fmt: skip
    way_mm = speed_mm_s * path.duration_s
    bench = MotionBench(edge_mm=way_mm / 2, plate_mm=way_mm + 10)
    # Compiled backends need milliseconds to start an image, longer than 16 pixels take.
    settings = RenderSettings(
        samples_per_pixel=16, max_depth=2, bands_nm=_BANDS_NM, backend="scalar"
    )
    scene = bench.build(Light(illuminance_lux=_LUX), _CAMERA, path)
    renderer = SceneRenderer(scene, _CAMERA, settings)
    instants = [
        renderer.radiance(pose, seed=frame_seed(0, instant))
        for instant, pose in enumerate(path.poses())
    ]
    starts = range(0, per_frame, per_frame // _PHASES)
    open_shutter = [instants[start : start + FRAMES * per_frame] for start in starts]
    frames = np.reshape(open_shutter, (_PHASES, FRAMES, per_frame, *instants[0].shape))
    forth = frames.mean(axis=2, dtype=np.float64)
    return np.concatenate([forth, forth[:, ::-1]], axis=1)


def record(speed_mm_s: float, sensor: Sensor, seed: int = 0) -> Exposure:
    """Expose 16 rows, (recordings·2·FRAMES, 16, 16), recordings concatenated."""
    # noise realizations of each phase
    rows = np.tile(_frames(speed_mm_s, sensor), (4, 1, 1, 1))
    name = f"motion bench, {speed_mm_s:g} mm/s, {sensor.name}"
    return expose(rows, _BANDS_NM, sensor, seed=seed, stream=name)


def passing_rates(speed_mm_s: float, sensor: Sensor) -> Floats:
    """Detection rates (recordings·2·FRAMES, 16, 16), Hz, one recording per phase."""
    return detection_rate(_frames(speed_mm_s, sensor), _BANDS_NM, sensor)


def _frames(speed_mm_s: float, sensor: Sensor) -> Floats:
    """Radiance (recordings·2·FRAMES, 16, 16, 1), one recording per phase."""
    radiance = stimulus(speed_mm_s) * _brightness(sensor)
    frames = radiance.reshape(-1, *radiance.shape[2:])
    return np.broadcast_to(frames, (len(frames), _ROWS, *frames.shape[2:]))


def pooled(counts: NDArray[Any]) -> Floats:
    """Reshape exposed frames to recordings of single rows, (2·FRAMES, recordings·16, 12)."""
    recordings = counts.reshape(-1, 2 * FRAMES, *counts.shape[1:]).swapaxes(0, 1)
    return triangular_pool(recordings.reshape(2 * FRAMES, -1, PIXELS))


@cache
def peaks(speed_mm_s: float, sensor: Sensor) -> dict[str, Peaks]:
    """Peak responses of NDM and NDS to every crossing at one speed."""
    noisy = pooled(record(speed_mm_s, sensor).counts)
    mean = expectation(_frames(speed_mm_s, sensor), _BANDS_NM, sensor).mean_reading
    ideal = pooled(mean)
    return {
        name: Peaks(crossing_peaks(detector(name), noisy), crossing_peaks(detector(name), ideal))
        for name in TIME_CONSTANTS_S
    }


def crossing_peaks(method: Detector, frames: Floats) -> Floats:
    """Largest response (crossings, rows, detectors) after the filters' transient."""
    responses = method.respond(frames)[..., 1:-1]
    crossings = responses.reshape(2, FRAMES, -1, _ROWS, responses.shape[-1])
    largest = crossings[:, method.memory_frames :].max(axis=1)
    return np.asarray(largest.reshape(-1, *largest.shape[2:]))


@cache
def _brightness(sensor: Sensor) -> float:
    """Factor on the rendered light for 65 detected photons per frame in open pixels."""
    beam = np.full((1, _ROWS, PIXELS, 1), sky_radiance(_LUX))
    return OPEN_PHOTONS / float(detection_rate(beam, _BANDS_NM, sensor).mean() * sensor.exposure_s)


LEAST = 2
"""Least number of passages to and fro; one says nothing about chance."""
_SHARE_BEYOND = 0.25
"""An edge passes when the mean count goes from this close to one level to this close to the other,
as a share of their difference."""


def cut_passages(counts: NDArray[Any], numbers: NDArray[Any] | None = None) -> NDArray[Any]:
    """Cut the passages of an edge from frames (T, rows, columns).

    With frame numbers, (T,), passages with a missing frame are skipped. Raises ValueError if
    no edge passes, too few do, or they follow each other too closely.

    Returns
    -------
    (passages · 2 · FRAMES, rows, columns)
    """
    edges = list(_edges(np.asarray(counts.mean(axis=(1, 2)), np.float64)))
    gap = min((second - first for (first, _), (second, _) in pairwise(edges)), default=FRAMES)
    # half a frame before and after the middle may be lost to rounding
    if gap < FRAMES - 2:
        raise ValueError(
            f"an edge passes {gap:.0f} frames after another; let the plate rest at its ends for a "
            f"gap of {FRAMES} frames"
        )
    number = np.arange(len(counts)) if numbers is None else numbers.astype(np.int64)
    complete = []
    for middle, hides in edges:
        start = round(middle) - FRAMES // 2
        last = start + FRAMES - 1
        if start >= 0 and last < len(counts) and number[last] - number[start] == FRAMES - 1:
            complete.append((start, hides))
    pairs = [(first, second) for (first, hides), (second, _) in pairwise(complete) if hides]
    if len(pairs) < LEAST:
        raise ValueError(
            f"{len(pairs)} passages of the plate to and fro in {len(counts)} frames; record "
            f"{LEAST} or more"
        )
    return np.concatenate([counts[start : start + FRAMES] for pair in pairs for start in pair])


def _edges(level: Floats) -> Iterator[tuple[float, bool]]:
    """Yield frames, from the opening of the first, of half of the array hidden, and if it falls."""
    low, high = np.percentile(level, (5, 95))
    # An edge is 6 σ or more; the median distance of neighbors, if normal, is 0.954 σ.
    if not high - low > 6.0 * np.median(np.abs(np.diff(level))) / 0.954:
        raise ValueError(
            f"no edge passes, the mean count is {level.mean():.1f} per pixel in every frame; let "
            "the plate pass"
        )
    half = (low + high) / 2
    hidden, free = np.median(level[level < half]), np.median(level[level > half])
    share = (level - hidden) / (free - hidden)
    known = np.flatnonzero((share < _SHARE_BEYOND) | (share > 1 - _SHARE_BEYOND))
    for before, after in pairwise(known):
        hides = bool(share[before] > 0.5)
        if hides == bool(share[after] > 0.5):
            continue
        falling = (share[before : after + 1] - 0.5) * (1 if hides else -1)
        last = np.flatnonzero((falling[:-1] > 0) & (falling[1:] <= 0))[-1]
        # The level of a frame is that at its middle.
        part = falling[last] / (falling[last] - falling[last + 1])
        yield float(before + last + part + 0.5), hides
