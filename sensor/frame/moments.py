"""Mean and variance of the electrons and readings of a frame camera, without drawing any.

Variances add up, with 1/12 DN² for rounding, where noise is above 0.7 DN and neither a well nor an
end of the ADC is near. Elsewhere moments are sums over numbers of electrons and codes. There, what
a register makes of a number is taken as normal: variances are then within 5 %, if `adc.black_dn`
exceeds the noise.
"""

import math

import numpy as np
from scipy.special import pdtr

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.frame.model import FrameSensor, pixels
from megalopta.sensor.optics import with_lag

_ENOUGH_DN, _FAR, _TAIL = 0.7, 9.0, 30.0
"""Noise that makes rounding uniform; standard deviations, and gains of an electron, to an end"""


def electron_moments(
    electrons_hz: Floats, sensor: FrameSensor, state: Floats | None = None
) -> tuple[Floats, Floats]:
    """Mean and variance (T, H, W) of the electrons that pixels collect, without a full well.

    `electrons_hz` (T, H, W), `state`: as for `expose_frames`.
    """
    device = pixels(sensor, (electrons_hz.shape[1], electrons_hz.shape[2]))
    lagged_hz, _ = with_lag(electrons_hz, sensor, state)
    mean_e = lagged_hz * device.response * sensor.exposure_s + device.dark_e
    return mean_e, mean_e.copy()


def reading_moments(
    electrons_hz: Floats, sensor: FrameSensor, state: Floats | None = None
) -> tuple[Floats, Floats]:
    """Mean and variance (T, H, W) of the readings, electrons and electrons²; as above."""
    mean_e, _ = electron_moments(electrons_hz, sensor, state)
    device = pixels(sensor, (mean_e.shape[1], mean_e.shape[2]))
    read, register, adc, well_e = sensor.read, sensor.em, sensor.adc, int(sensor.full_well_e)
    gain, step_e = register.gain, adc.e_per_dn
    noise_e2 = device.read_e**2 + read.row_e**2 + read.column_e**2
    level_e, offset_e = 0.5 * read.telegraph_e * device.traps.step, device.offset_e
    charge_e, charge_e2 = gain * mean_e, gain**2 * register.excess_noise * mean_e
    mean, variance = charge_e + offset_e, charge_e2 + noise_e2 + level_e**2 + step_e**2 / 12

    reach_e, around_e = _FAR * np.sqrt(charge_e2), _FAR * np.sqrt(noise_e2) + level_e
    high_e = charge_e + reach_e + _TAIL * gain * (gain > 1)
    low_e = np.maximum(charge_e - reach_e, 0) - around_e + offset_e
    is_near = (noise_e2 < (_ENOUGH_DN * step_e) ** 2) | (low_e < -adc.black_dn * step_e)
    is_near |= high_e + around_e + offset_e > (adc.largest_dn - adc.black_dn) * step_e
    is_near |= (high_e > register.well_e) | (mean_e > well_e - _FAR * (well_e**0.5 + 1))
    if is_near.any():
        full = 1 - pdtr(well_e - 1, mean_e)
        of_pixels = np.broadcast_arrays(mean_e, full, offset_e, noise_e2, level_e)
        of_one_e2 = gain**2 * (register.excess_noise - 1)
        of_sensor = well_e, gain, of_one_e2, register.well_e, step_e, adc.black_dn, adc.largest_dn
        stats = np.empty((2, np.count_nonzero(is_near)))
        _sum_over_electrons(*(of[is_near] for of in of_pixels), tuple(map(float, of_sensor)), stats)
        mean[is_near], variance[is_near] = stats
    return mean / gain, variance / gain**2


@compiled
def _sum_over_electrons(  # type: ignore[no-untyped-def]
    means_e, full, offsets_e, noises_e2, levels_e, of_sensor, found
):
    """Write mean and variance (2, N) behind the ADC; `full`: probability of a full well."""
    well_e, gain, of_one_e2, register_well_e, step_e, black_dn, largest_dn = of_sensor
    for k in range(means_e.size):
        mean_e, sigma_e = means_e[k], math.sqrt(means_e[k])
        # numbers are skipped where probabilities hardly change; odd, so that all roundings occur
        steps = 16 if noises_e2[k] >= (_ENOUGH_DN * step_e) ** 2 else 64
        skip = sigma_e // steps // 2 * 2 + 1
        last = min(mean_e + _FAR * sigma_e + 18, well_e - 1)
        n = math.floor(max(mean_e - _FAR * (sigma_e + 1), 0.0)) if full[k] < 1 else well_e
        n += (well_e - (skip + 1) / 2 - n) % skip  # in the middle of those up to the well
        reference_dn = np.rint((min(gain * mean_e, largest_dn * step_e) + offsets_e[k]) / step_e)
        ends = -black_dn - reference_dn, largest_dn - black_dn - reference_dn
        total = mean = square = 0.0
        while n <= last or full[k] > 0:
            if n > last:
                n, share = well_e, full[k]
            else:
                logs = n * math.log(mean_e) - math.lgamma(n + 1) if n else 0.0
                share = skip * math.exp(logs - mean_e)
            charge_e, charge_e2 = n * gain, n * of_one_e2
            if gain > 1:
                charge_e, charge_e2 = _held(charge_e, charge_e2, -1e15, register_well_e, 0.0)
            for sign in (-1, 1):
                volts_e = charge_e + offsets_e[k] + sign * levels_e[k]
                spread_dn2 = (charge_e2 + noises_e2[k]) / step_e**2
                read, read2 = _held(volts_e / step_e - reference_dn, spread_dn2, *ends, 1.0)
                total += share / 2
                mean += share / 2 * read
                square += share / 2 * (read2 + read * read)
            if n == well_e:
                break
            n += skip
        mean, square = mean / total, square / total
        found[0, k] = (mean + reference_dn) * step_e
        found[1, k] = max(square - mean * mean, 0.0) * step_e**2


@compiled
def _held(mean, variance, low, high, code):  # type: ignore[no-untyped-def]
    """Mean and variance of a normal number held at two ends, and rounded to multiples of a code.

    `code`: 1, or 0 without rounding. They are sums of the chances to exceed the middles between
    codes, or between places a quarter of a standard deviation apart.
    """
    sigma = math.sqrt(variance)
    if sigma >= _ENOUGH_DN * code and mean - _FAR * sigma > low and mean + _FAR * sigma < high:
        return mean, variance + code**2 / 12
    first = min(max(low + np.rint(mean - low - 7 * sigma), low), high)
    last = min(max(low + np.rint(mean - low + 7 * sigma), low), high)
    places = math.ceil((last - first) / max(1.0, sigma / 4))
    step = (last - first) / max(places, 1)
    total = square = free = above = 0.0
    for place in range(places):
        above = 0.5 * math.erfc((first + (place + 0.5) * step - mean) / math.sqrt(2 * variance))
        free = max(free, above)
        total += above
        square += (2 * place + 1) * above
    rounding = (code**2 - step**2) / 12 * (free - above)
    return first + step * total, max(step**2 * (square - total**2) + rounding, 0.0)
