"""The comb: readings stand one step apart, so their histogram has a period, which is the step.

The length of the mean phase |Σ exp(2πi·V/s)|/n over trial steps s is largest at the step, where
read noise r leaves exp(−2π²·r²/s²) of it. Levels have phases of their own (leak), so squares are
summed. Between the trials the maximum is that of a parabola.

Source: the empirical characteristic function at the frequency of the comb, which starts PCH-EM
(Hendrickson and Haefner, arXiv 2302.00090, use a Fourier transform of the histogram too).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.level import Falls

HIDDEN_AT = 0.36
"""Read noise over step above which the comb is too faint to fit."""
_TRIALS_PER_PEAK = 4


def comb_period(falls: Falls, around_v: Floats, within: float) -> tuple[Floats, Floats]:
    """Find the period of the readings of each pixel.

    Parameters
    ----------
    falls : Falls
    around_v : (P,)
        Where to look for the period (V).
    within : float
        How far around that, relative.

    Returns
    -------
    period_v : (P,)
        The period (V).
    noise : (P,)
        Read noise over it, as the height of the peak says.
    """
    period, noise = np.empty(around_v.size), np.empty(around_v.size)
    order = np.argsort(falls.pixel, kind="stable")
    ends = np.searchsorted(falls.pixel[order], np.arange(around_v.size + 1))
    for pixel, start, end in zip(range(around_v.size), ends[:-1], ends[1:], strict=True):
        own = order[start:end]
        period[pixel], noise[pixel] = _of_pixel(
            falls.fall_v[own],
            falls.times[own],
            np.flatnonzero(np.diff(falls.level[own], prepend=-1)),
            around_v[pixel],
            within,
        )
    return period, noise


def _of_pixel(
    fall_v: Floats, times: Floats, starts: NDArray[np.intp], around_v: float, within: float
) -> tuple[float, float]:
    if not starts.size or not around_v > 0:
        return np.nan, np.inf
    teeth = max(np.ptp(fall_v) / around_v, 4.0)
    trials = int(np.ceil(2 * within * teeth * _TRIALS_PER_PEAK)) + 3
    frequency = np.linspace(1 - within, 1 + within, trials) / around_v
    step = float(frequency[1] - frequency[0])
    phase = 2j * np.pi * (fall_v - fall_v.mean())
    wave, turn = times * np.exp(frequency[0] * phase), np.exp(step * phase)
    power = _powers(wave, turn, np.append(starts, fall_v.size), times, trials)
    best = int(np.clip(np.argmax(power), 1, trials - 2))
    left, middle, right = power[best - 1 : best + 2]
    bend = left - 2 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
    height = min(max(float(middle), 1e-12), 1 - 1e-12)
    noise = float(np.sqrt(-np.log(height) / (4 * np.pi**2)))
    return 1 / float(frequency[best] + shift * step), noise


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _powers(
    wave: NDArray[np.complex128],
    turn: NDArray[np.complex128],
    ends: NDArray[np.intp],
    times: Floats,
    trials: int,
) -> Floats:
    """Mean over readings of the squared mean phases of levels; a turn from trial to trial."""
    power = np.zeros(trials)
    for at in range(len(ends) - 1):
        own = slice(ends[at], ends[at + 1])
        total = times[own].sum()
        here, by = wave[own].copy(), turn[own]
        for trial in range(trials):
            real, imaginary = 0.0, 0.0
            for reading in range(here.size):
                real += here[reading].real
                imaginary += here[reading].imag
                here[reading] *= by[reading]
            power[trial] += (real**2 + imaginary**2) / total
    power /= times.sum()
    return power
