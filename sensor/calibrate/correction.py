"""Corrected frames: linearize, subtract dark, divide by flat, fill in unusable pixels.

The response curve is the reading of a pixel over its arrivals, of the device model, with all its
effects under uniform light. With paralyzable dead time, or a counter that wraps, a reading can
stand for several brightnesses; the dimmest is taken, and ambiguous readings are flagged.

A reading scatters by σ, so any function of it, such as the inverse of the curve, has a bias of half
its curvature times σ². This is subtracted from arrivals and from their variance.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import convolve

from megalopta.core.arrays import Floats, Mask, robust_sigma
from megalopta.sensor.calibrate.pixels import hot_pixels
from megalopta.sensor.change import changed
from megalopta.sensor.effects.dead_time import MOST_ARRIVALS
from megalopta.sensor.expectations import reading_moments
from megalopta.sensor.exposure import expose_rate
from megalopta.sensor.frame import exposure, moments
from megalopta.sensor.frame.model import FixedPattern, FrameSensor
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.measured import MeasuredMaps
from megalopta.sensor.spad.model import Sensor, without

_WEIGHTS = np.array([[0.5, 1.0, 0.5], [1.0, 0.0, 1.0], [0.5, 1.0, 0.5]])
_FRAMES_AT_ONCE = 16


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """Mean and variance of readings over arrivals per exposure, each (n,)."""

    arrivals: Floats
    """Detectable photons plus dark counts, as far as readings rise with them"""
    mean: Floats
    variance: Floats
    ambiguous_from: float
    """Reading from which more than the last arrivals are possible; infinite if never"""

    @property
    def largest(self) -> float:
        """Largest reading that determines the arrivals."""
        return float(self.mean[-1])

    def arrivals_of(self, readings: Floats, frames: int = 1) -> Floats:
        """Return the arrivals of readings of any shape, or of means over frames.

        Readings below the dark reading give negative arrivals, so that means are unbiased. Readings
        above `largest` give those of `largest`.
        """
        inverse = PchipInterpolator(self.mean, self.arrivals)
        bent = np.clip(readings, self.mean[0], self.mean[-1])
        arrivals = inverse(bent) - self._excess(self.arrivals, bent) / frames
        arrivals += np.minimum(readings - self.mean[0], 0) * inverse(self.mean[0], 1)
        return np.asarray(arrivals)

    def variance_of(self, readings: Floats) -> Floats:
        """Return the variance of the arrivals of single readings, of any shape."""
        bent = np.clip(readings, self.mean[0], self.mean[-1])
        spread = np.gradient(self.arrivals, self.mean) ** 2 * self.variance
        variance = np.interp(bent, self.mean, spread) - self._excess(spread, bent)
        return np.asarray(np.maximum(variance, 0))

    def _excess(self, values: Floats, readings: Floats) -> Floats:
        """Bias of a function of the reading, averaged over the noise."""
        slopes = np.gradient(values, self.mean)
        excess = 0.5 * np.gradient(slopes, self.mean) * self.variance
        return np.asarray(np.interp(readings, self.mean, excess))


def response_curve(sensor: Sensor | FrameSensor) -> ResponseCurve:
    """Return the response curve of the array's mean pixel, without dark counts.

    Raises ValueError if no reading determines the arrivals.
    """
    if isinstance(sensor, FrameSensor):
        even = sensor.model_copy(update={"pattern": FixedPattern(), "cic_e": 0.0})
        even = changed(even, dark={"mean_e_s": 0.0}, lag_share=0.0)
        arrivals = np.concatenate(([0.0], np.geomspace(1e-3, 4 * even.full_well_e, 400)))
        # read noise differs between pixels
        rates_hz = np.broadcast_to(arrivals[:, None, None] / even.exposure_s, (401, 16, 16))
        mean, variance = np.mean(moments.reading_moments(rates_hz, even), axis=(2, 3))
        return _rising(sensor.name, arrivals, mean, variance)
    if sensor.largest == 1:
        raise ValueError(
            f"sensor {sensor.name!r}: one event saturates its counter; nothing can be corrected"
        )
    # pixels that do not differ, neither as drawn nor as measured
    alike: dict[str, Any] = {
        part: {name: 0.0 for name in type(getattr(sensor, part)).model_fields if "sigma" in name}
        for part in ("counter", "dead_time", "afterpulsing", "crosstalk")
    }
    plain = sensor.model_copy(update={"measured": MeasuredMaps()})
    plain = changed(without(plain, "dark_counts"), **alike)
    # arrivals beyond which readings no longer rise, due to the counter or the dead time
    most = min(4.0 * plain.largest, MOST_ARRIVALS / 2)
    if plain.dead_time.kind != "ideal" and plain.dead_time.dead_time_s:
        most = min(most, 20 * plain.exposure_s / plain.dead_time.dead_time_s)
    # neighbors matter only with crosstalk
    side = 9 if plain.crosstalk.is_on else 1
    # the curve is straight below the first
    arrivals = np.concatenate(([0.0], np.geomspace(1e-3, most, 400)))
    rates = np.broadcast_to(arrivals[:, None, None] / plain.exposure_s, (arrivals.size, side, side))
    mean, variance = np.array(reading_moments(rates, plain))[:, :, side // 2, side // 2]
    # readings that brighter light beyond a peak of the curve may give, too
    ambiguous_from = np.inf
    wraps = getattr(plain.counter, "overflow", "saturate") == "wrap"
    if plain.dead_time.kind == "paralyzable" or wraps:
        peak = int(np.argmax(mean))
        after = (np.arange(arrivals.size) > peak) & (arrivals <= 2.0 * arrivals[peak])
        lowest = mean[after] - 3 * np.sqrt(variance[after])
        ambiguous_from = float(np.min(lowest, initial=np.inf))
    return _rising(sensor.name, arrivals, mean, variance, ambiguous_from)


def _rising(
    name: str, arrivals: Floats, mean: Floats, variance: Floats, ambiguous_from: float = np.inf
) -> ResponseCurve:
    """Curve up to where it is too flat to invert."""
    slopes = np.diff(mean) / np.diff(arrivals)
    flat = np.flatnonzero(slopes < 0.05 * slopes[:10].max())
    end = int(flat[0]) if flat.size else arrivals.size - 1
    if end < 2:
        raise ValueError(
            f"sensor {name!r}: its readings do not rise with the light; nothing can be corrected"
        )
    rising = slice(0, end + 1)
    return ResponseCurve(arrivals[rising], mean[rising], variance[rising], ambiguous_from)


def filled_in(values: Floats, variance: Floats, bad: Mask) -> tuple[Floats, Floats]:
    """Return frames with bad pixels replaced by the mean of good neighbors, and the variance.

    Edge neighbors weigh twice as much as corner neighbors. If all eight are bad, those filled in
    before are used. A frame without any good pixel is unchanged.

    `values`, `variance` (T, rows, columns); `bad` (rows, columns) or (T, rows, columns).
    """
    values, variance = values.copy(), variance.copy()
    known = np.broadcast_to(~bad, values.shape).copy()
    known |= ~known.any(axis=(1, 2), keepdims=True)
    weights = _WEIGHTS[np.newaxis]
    while not known.all():
        total = convolve(known.astype(np.float64), weights, mode="constant")
        fill = ~known & (total > 0)
        sums = convolve(np.where(known, values, 0), weights, mode="constant")
        spread = convolve(np.where(known, variance, 0), weights**2, mode="constant")
        values[fill] = sums[fill] / total[fill]
        variance[fill] = spread[fill] / total[fill] ** 2
        known |= fill
    return values, variance


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibration of a device; each map is (rows, columns)."""

    curve: ResponseCurve
    """Readings to arrivals"""
    dark: Floats
    """Dark counts per exposure"""
    dark_variance: Floats
    """Variance of this estimate"""
    gain: Floats
    """Efficiency relative to the mean of the good pixels, or, if simulated, to the nominal one"""
    gain_variance: Floats
    bad: Mask
    """Hot or dead pixels"""


def calibrate(
    dark_frames: Any, flat_frames: Any, sensor: Sensor | FrameSensor, *, hot_times: float = 10.0
) -> Calibration:
    """Estimate a device's calibration from dark and flat frames, each (n, rows, columns).

    Readings without light and under uniform light at the sensor's exposure, counts or electrons of
    a frame camera, in memory or on disk. Pixels with surely more dark counts than `hot_times` the
    median are hot; of a frame camera those surely above the median by so many standard deviations
    over pixels. Raises ValueError if there are fewer than two frames, shapes differ, or the flat
    frames are too dark or too bright to determine a gain.
    """
    of_dark, of_flat = np.shape(dark_frames), np.shape(flat_frames)
    if of_dark[1:] != of_flat[1:] or len(of_dark) != 3 or min(of_dark[0], of_flat[0]) < 2:
        raise ValueError(
            f"dark frames of shape {of_dark} and flat frames of {of_flat}; give (frames, rows, "
            "columns) of one device, two or more frames"
        )

    def chunks(frames: Any) -> Iterator[Floats]:
        for first in range(0, len(frames), _FRAMES_AT_ONCE):
            yield np.asarray(frames[first : first + _FRAMES_AT_ONCE], np.float64)

    curve = response_curve(sensor)
    dark, flat = (_mean(chunks(frames), curve) for frames in (dark_frames, flat_frames))
    return _of_means(sensor, curve, dark, flat, None, hot_times)


def simulated_calibration(
    sensor: Sensor | FrameSensor, shape: tuple[int, int], *, frames: int = 256, seed: int = 0,
    hot_times: float = 10.0,
) -> Calibration:  # fmt: skip
    """Calibrate a simulated device from frames in the dark and at half of the largest reading.

    So many frames of each kind, of `shape` (rows, columns); `hot_times` as for `calibrate`.
    """
    curve = response_curve(sensor)
    detections = float(curve.arrivals_of(np.array([curve.largest / 2]))[0])
    factor = np.ones(shape)  # the model of a frame camera has its own
    if isinstance(sensor, Sensor):
        factor = draw_fixed_pattern(sensor, shape).efficiency_factor

    def drawn(name: str, rate_hz: Floats) -> Iterator[NDArray[Any]]:
        for first in range(0, frames, _FRAMES_AT_ONCE):
            rates_hz = np.broadcast_to(rate_hz, (min(_FRAMES_AT_ONCE, frames - first), *shape))
            stream = f"calibration {name}"
            if isinstance(sensor, FrameSensor):  # lag changes no frame but the first
                draw, even = Draw(seed, stream, first), changed(sensor, lag_share=0.0)
                yield exposure.expose_frames(rates_hz, even, draw)[0].counts
                continue
            yield expose_rate(rates_hz, sensor, seed=seed, stream=stream, first_frame=first).counts

    dark = _mean(drawn("dark", np.zeros(shape)), curve)
    flat = _mean(drawn("flat", detections / sensor.exposure_s * factor), curve)
    return _of_means(sensor, curve, dark, flat, detections, hot_times)


class _Mean(NamedTuple):
    """Mean arrivals over frames, the variance of that mean, and mean readings."""

    arrivals: Floats
    variance: Floats
    readings: Floats
    frames: int


def _mean(chunks: Iterable[NDArray[Any]], curve: ResponseCurve) -> _Mean:
    frames, sums, squares = 0, np.zeros(()), np.zeros(())
    for chunk in chunks:
        frames += len(chunk)
        sums = sums + chunk.sum(axis=0, dtype=np.float64)
        squares = squares + np.square(chunk, dtype=np.float64).sum(axis=0)
    readings = sums / frames
    spread = np.maximum(squares / frames - readings**2, 0) / (frames - 1)
    slope = np.interp(readings, curve.mean, np.gradient(curve.arrivals, curve.mean))
    return _Mean(curve.arrivals_of(readings, frames), slope**2 * spread, readings, frames)


def _of_means(
    sensor: Sensor | FrameSensor, curve: ResponseCurve, dark: _Mean, flat: _Mean,
    flat_detections: float | None, hot_times: float,
) -> Calibration:  # fmt: skip
    light = flat.arrivals - dark.arrivals
    # three standard errors; of no count, the error is that of one
    error = 3.0 * np.sqrt(np.maximum(dark.variance, 1 / dark.frames**2))
    if isinstance(sensor, FrameSensor):
        apart = dark.arrivals - np.median(dark.arrivals)
        bad = apart - error > hot_times * robust_sigma(apart)
    else:
        bad = hot_pixels(dark.arrivals - error, dark.arrivals, dark.arrivals + error, hot_times)
    if 2 * int(bad.sum()) >= bad.size:
        raise ValueError(
            f"hot_times: {hot_times:g} times the median of the dark counts marks {bad.mean():.0%} "
            "of the pixels; give more"
        )
    bad |= flat.readings >= 0.95 * curve.largest
    bad |= light < 0.2 * np.median(light)
    if bad.all() or not np.median(light) > 0:
        raise ValueError(
            f"flat frames: too dark or too bright to estimate gains; readings well above the dark "
            f"and below {curve.largest:.4g} are needed"
        )
    even = float(light[~bad].mean()) if flat_detections is None else flat_detections
    gain = np.where(bad, 1.0, light / even)
    gain_variance = (flat.variance + dark.variance) / even**2
    return Calibration(curve, dark.arrivals, dark.variance, gain, gain_variance, bad)


@dataclass(frozen=True, eq=False)
class Corrected:
    """Frames (T, H, W) as an ideal array of the same efficiency would detect them, on average."""

    detections: Floats
    """Detected photons per exposure, without dark counts; noise can make them negative"""
    variance: Floats
    """Variance of these, from the noise of the reading, the dark and the flat frames"""
    filled: Mask
    """Pixels that are hot, dead or saturated, replaced by neighbors; all of a frame without good
    pixels"""
    ambiguous: Mask
    """Pixels that may have received much more light (`ResponseCurve.ambiguous_from`)"""


def correct(counts: ArrayLike, saturated: ArrayLike, calibration: Calibration) -> Corrected:
    """Correct frames of readings, `counts` and `saturated` (T, H, W) as in `Exposure`.

    By a calibration of the same device. Raises ValueError if shapes do not match.
    """
    curve, gain = calibration.curve, calibration.gain
    readings, full = np.asarray(counts, np.float64), np.asarray(saturated, np.bool_)
    if readings.ndim != 3 or readings.shape[1:] != gain.shape:
        raise ValueError(
            f"counts: shape {readings.shape}; give (frames, rows, columns) of the {gain.shape} "
            "pixels that were calibrated"
        )
    if full.shape != readings.shape:
        raise ValueError(f"saturated: shape {full.shape}; give {readings.shape}, as the counts")
    detections = (curve.arrivals_of(readings) - calibration.dark) / gain
    of_gain = detections**2 * calibration.gain_variance
    variance = (curve.variance_of(readings) + calibration.dark_variance + of_gain) / gain**2
    filled = full | (readings > curve.largest) | calibration.bad
    detections, variance = filled_in(detections, variance, filled)
    return Corrected(detections, variance, filled, readings >= curve.ambiguous_from)
