"""A device from the codes of its ADC: comb, then events as any counting camera has them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from megalopta.sensor.calibrate.comb import HIDDEN_AT, CombFit, Curve, comb_period, fit_comb
from megalopta.sensor.calibrate.counts import CountingDevice, Summed, calibrate_counts
from megalopta.sensor.calibrate.level import Drops, Level, check_levels, drops_of, photon_transfer
from megalopta.sensor.calibrate.pixels import Estimate, Quantity
from megalopta.sensor.calibrate.statistics import statistics
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.spad.counters import AnalogCounter

_LOUDEST = 2.0
"""Residual, relative to the comb's median, above which a pixel's fit has failed."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class AnalogDevice(CountingDevice):
    """Estimates of a device whose events an analog counter counts, and the data behind them."""

    offset_v: Estimate
    """Drop of the output below the top of the ADC without events or leak: positive lowers it, as
    events do. `AnalogPixels.offset_v` and the map `offset` of a device file, which add to the
    output, have the opposite sign."""
    leak_v_s: Estimate
    step_v: Estimate
    read_noise_v: Estimate
    drops: Drops
    curve: Curve
    """Change of the step over the swing"""
    slope_error: float
    """Standard error of its slope; infinite if it is not determined"""

    @property
    def quantities(self) -> list[Quantity]:
        """Estimates of every pixel."""
        own = {"step": "step_v", "offset": "offset_v", "read noise": "read_noise_v"}
        parts = [Quantity(name, "mV", getattr(self, field), 1e3) for name, field in own.items()]
        return [*super().quantities, *parts, Quantity("leak", "mV/s", self.leak_v_s, 1e3)]

    @property
    def is_slope_seen(self) -> bool:
        """True if the step changes over the swing, beyond 3 standard errors."""
        return abs(self.curve.slope) > 3 * self.slope_error


def calibrate_device(
    levels: Sequence[Level], counter: AnalogCounter, known: DeadTime | None = None
) -> AnalogDevice:
    """Estimate what recordings of ADC codes determine of an analog counter and its pixels.

    Raises ValueError if they are insufficient (`check_levels`), noise hides single events, or the
    shortest dark exposure is too long to determine the reading of no counts.

    Parameters
    ----------
    levels
        Codes in the dark at three or more exposures, and under uniform light at any number.
    counter
        Its supply, swing and ADC.
    known
        Dead time that corrects counts if levels do not determine it.

    Returns
    -------
    AnalogDevice
        As `calibrate_counts`, and maps of offset, leak, step and read noise.

    Examples
    --------
    >>> from megalopta.sensor import changed, expose_adc, preset
    >>> camera, none = preset("spadcam"), np.zeros((60, 4, 4))
    >>> dark = [
    ...     Level(expose_adc(none, changed(camera, exposure_s=s), seed=0, stream=f"{s} s"), s)
    ...     for s in (1e-3, 1e-2, 5e-2)
    ... ]
    >>> round(1e3 * calibrate_device(dark, camera.counter).step_v.median, 1)  # mV
    10.0
    """
    check_levels(levels, counter)
    shape = levels[0].readings.shape[1], levels[0].readings.shape[2]
    drops = drops_of(levels, counter)
    fit = _fitted_comb(drops, counter)
    errors = np.sqrt(np.maximum(np.diagonal(fit.covariance, axis1=1, axis2=2), 0))
    # peaks were misassigned: noise or leak is implausible
    leak_v_s = fit.solution[:, 1]
    failed = ~(fit.noise_v <= _LOUDEST * np.median(fit.noise_v))
    failed |= (leak_v_s < -5.0 * errors[:, 1]) | (drops.frames.sum(axis=0) == 0)
    # peaks that are off by whole counts at the longest exposure look like leak
    distance = np.abs(leak_v_s - np.median(leak_v_s))
    failed |= distance > 40.0 * np.median(distance)
    errors[failed], drops.frames[:, failed] = np.nan, 0
    offset, leak, step = (
        Estimate.normal(*column, shape) for column in zip(fit.solution.T, errors.T, strict=True)
    )
    read_v = np.sqrt(np.maximum(fit.noise_v**2 - counter.lsb_v**2 / 12, 0))
    read_error = fit.noise_v**2 / np.sqrt(2 * np.maximum(fit.readings, 1))
    recordings = [_events(level, at, drops, fit, counter) for at, level in enumerate(levels)]
    return AnalogDevice(
        **vars(calibrate_counts(recordings, known)),
        offset_v=offset, leak_v_s=leak, step_v=step,
        read_noise_v=Estimate.normal(read_v, read_error / np.maximum(read_v, 1e-12), shape),
        drops=drops, curve=fit.curve, slope_error=fit.slope_error,
    )  # fmt: skip


def _events(level: Level, at: int, drops: Drops, fit: CombFit, counter: AnalogCounter) -> Summed:
    """Sum up the events of a level, of whose number readings between two peaks leave a doubt."""
    shape = level.readings.shape[1:]
    offset_v, leak_v_s, step_v = fit.solution.T.reshape(3, *shape)
    drop_v = counter.supply_v - level.readings * counter.lsb_v
    steps = (drop_v - offset_v - leak_v_s * level.exposure_s) / step_v
    is_known, is_fitted = (
        frames.reshape(shape) > 0 for frames in (drops.frames[at], drops.frames.sum(axis=0))
    )
    numbers = np.where(is_fitted, fit.curve.numbers(steps, step_v), 0)
    of, n = statistics(np.rint(numbers)), len(numbers)
    mean = (fit.counts[at] / n).reshape(shape)
    variance = (fit.squares[at].reshape(shape) / n - mean**2) * n / (n - 1)
    of = of._replace(
        mean=np.where(is_known, mean, of.mean), variance=np.where(is_known, variance, of.variance)
    )
    return Summed(level.exposure_s, level.light_hz, False, of, is_known)


def _fitted_comb(drops: Drops, counter: AnalogCounter) -> CombFit:
    """Comb of each pixel, with steps about as by photon transfer, then by its period."""
    transfer = photon_transfer(drops)
    typical_v = float(np.median(transfer.step_v))
    low, high = np.percentile(transfer.step_v, (16, 84)) / typical_v
    error = float(np.median(transfer.step_error_v)) / typical_v
    scatter = np.sqrt(max(((high - low) / 2) ** 2 - error**2, 0.0))
    within = 5.0 * max(scatter, error / np.sqrt(transfer.step_v.size))
    within = float(np.clip(within, 0.15, 0.25))
    # below, a changing step blurs the comb
    is_shallow = drops.mean_v[drops.level, drops.pixel] < 0.12 * counter.swing_v
    step_v, noise = comb_period(drops.at(is_shallow), typical_v, within)
    # outputs that the ADC cuts off look like a peak; the variance reveals them
    noise = np.maximum(noise, np.sqrt(transfer.read_variance_v2) / transfer.step_v)
    if np.median(noise) > HIDDEN_AT:
        raise ValueError(
            f"read noise of {np.median(noise):.2g} steps hides single events; lower it to "
            f"{HIDDEN_AT:g} or less, or calibrate from counts"
        )
    # in steps: peaks cannot be distinguished
    if np.median(transfer.offset_error_v / step_v) > 0.2:
        raise ValueError(
            "dark frames: the shortest exposure is too long to find the reading of no counts; add "
            "shorter ones, with few or no counts per frame"
        )
    fit = fit_comb(drops, step_v, transfer.offset_v, counter.swing_v)
    if np.median(fit.noise_v / fit.solution[:, 2]) > _LOUDEST * np.median(noise):
        raise ValueError(
            "the peaks of the comb cannot be followed through the swing, as if the step changed by "
            "more than a tenth over it; omit the levels with most counts"
        )
    return fit
