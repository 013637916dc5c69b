"""Times of events: histograms of photons by their time after a pulse, and jitter.

**Time-correlated single-photon counting**: pulsed light, a time-to-digital converter per pixel.

The converter records the first avalanche of a period, which the pixel is ready for: at a rate λ(t)
with probability p(t) = λ(t)·exp(−∫₀ᵗ λ), pile-up. The time stamp scatters by the sensor's jitter
over the end of the period too. Numbers in the bins of N periods are multinomial.

This assumes that pixels are ready at the start of each period, and that light alone fires them. For
others (`histograms.is_ready`) photons are drawn one by one, what they fire is followed as in all
arrays (`spad.kernel`), and the first avalanche of each period is kept (`sorted_in_time`).

Source: O'Connor and Phillips, Time-correlated Single Photon Counting (1984), for pile-up.

**Jitter**: scatter of event time stamps about the arrival of the photon.

Normal with mean 0, the same for all events and independent between events. A share of the events
comes later by an exponential time, the diffusion tail: their carriers are set free below the
junction and diffuse there first. With this share p and the mean τ of that time, a stamp has

    mean p·τ       variance σ² + p·τ²·(2 − p)

Jitter moves time stamps only: which avalanches occur is decided before. Stamps may lie outside the
exposure, and their order may change; neither is corrected, as the event still belongs to its frame.

Source: dissertation §2.3.2; Ripamonti and Cova, Solid-State Electronics 28, 925 (1985), for the
tail.
"""

from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.effects.base import Effect
from megalopta.sensor.effects.gating import Gate, open_time


class Jitter(Effect, frozen=True):
    """Scatter of the time stamps; none by default."""

    sigma_s: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of a time stamp (s)."""
    tail_share: Annotated[float, Field(ge=0, le=1, exclude_if=lambda share: share == 0)] = 0.0
    """Share of the events that come later by an exponential time (0 to 1)."""
    tail_s: Annotated[float, Field(ge=0, exclude_if=lambda mean: mean == 0)] = 0.0
    """Mean of that time (s)."""


def stamp(rng: np.random.Generator, times_s: Floats, jitter: Jitter) -> Floats:
    """Return time stamps (N,), s, of events at these times."""
    if not jitter.is_on:
        return times_s
    stamps = times_s + jitter.sigma_s * rng.standard_normal(times_s.size)
    if jitter.tail_share * jitter.tail_s > 0:
        is_late = rng.random(times_s.size) < jitter.tail_share
        stamps += is_late * rng.exponential(jitter.tail_s, times_s.size)
    return stamps


_PER_SIGMA = 4.0
_FARTHEST = 9.0
"""Standard deviations after which a pulse has ended."""
_LATEST = 30.0
_SHORT = 1e-5
"""Decay over standard deviation below which it is a delay."""


class Tcspc(Effect, frozen=True):
    """Pulsed light whose photons are counted by their time; off by default."""

    switch: ClassVar[str] = "bins"

    bins: Annotated[int, Field(ge=0, le=65536)] = 0
    """Bins of the converter in one period (0: no histograms)."""
    period_s: Annotated[float, Field(gt=0)] = 25e-9
    """Time between two pulses (s)."""
    pulsed_share: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Share of the light that is pulsed (0 to 1)."""
    pulse_sigma_s: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of a pulse (s)."""
    decay_s: Annotated[float, Field(ge=0)] = 0.0
    """Mean of the exponential delay of a photon, such as a fluorescence lifetime (s)."""
    delay_s: Annotated[float, Field(ge=0)] = 0.0
    """Delay of the pulse, such as the time of flight (s)."""
    from_camera: bool = False
    """True: the source is at the camera, and to delay_s adds the time of light to what a pixel sees
    and back. Needs the depth of a rendered sequence; the sky returns no pulse."""


def first_photon_shares(
    pulsed: Floats,
    constant: Floats,
    later_s: Floats | None,
    tcspc: Tcspc,
    jitter: Jitter,
    gate: Gate,
) -> Floats:
    """Return the probability of a count in each bin of a period, (…, bins).

    Parameters
    ----------
    pulsed, constant : (…)
        Mean arrivals per period, of pulses and of all other light and dark counts.
    later_s : (…), optional
        Further delay of each pulse; it is moved by parts of a bin, and in between by their mixture,
        which widens it by less than a hundredth of what blurs it.
    gate : Gate
        Window that opens once a period, or a whole number of times.
    """
    widths_s = tcspc.pulse_sigma_s, tcspc.decay_s, jitter.sigma_s, jitter.tail_s
    blur_s = [width_s for width_s in widths_s if width_s > 0]
    bin_s = tcspc.period_s / tcspc.bins
    # light is constant in each of at most 64 parts of a bin
    parts = int(np.clip(np.ceil(_PER_SIGMA * bin_s / min(blur_s)), 1, 64)) if blur_s else 1
    fine = tcspc.bins * parts
    ends = tcspc.period_s * np.arange(fine + 1) / fine
    opened: Any = 1.0  # share of time
    if gate.is_on:
        opened = np.diff([open_time(end, *gate.window) for end in ends]) / ends[1]
    delay_s = tcspc.delay_s % tcspc.period_s
    pulse = _wrapped(ends - delay_s, tcspc.pulse_sigma_s, tcspc.decay_s, tcspc.period_s)
    is_instant = tcspc.pulse_sigma_s + tcspc.decay_s == 0
    # after the middle of the part of a bin that has all of an instant
    late_s = delay_s - (np.argmax(pulse) + 0.5) * ends[1] if is_instant else 0.0
    offsets_s = (late_s, 0.0) if is_instant else (0.0,)
    responses = [
        np.fft.rfft(_response(ends - offset_s, tcspc.period_s, jitter))
        for offset_s in (offsets_s if jitter.is_on else ())
    ]
    is_blurred = jitter.is_on or not is_instant
    arrivals = np.stack(np.broadcast_arrays(pulsed, constant), axis=-1)
    shares = np.empty((arrivals[..., 0].size, tcspc.bins))
    at_once = max(1, 2**22 // fine)  # values, 32 MiB
    for start in range(0, len(shares), at_once):
        pixels = slice(start, start + at_once)
        of_pulse, steady = arrivals.reshape(-1, 2, 1)[pixels].swapaxes(0, 1)
        moved, by = pulse, np.zeros((1, 1))
        if later_s is not None:
            by = later_s.reshape(-1, 1)[pixels] / tcspc.period_s * fine
            places = np.floor(by).astype(np.int64)
            share = by - places if is_blurred else 0.0
            place = np.arange(pulse.size) - places
            moved = np.asarray(
                (1 - share) * pulse[place % pulse.size] + share * pulse[(place - 1) % pulse.size]
            )
        seen = opened
        if gate.period_s and gate.width_s and is_instant:  # in the window or not
            seen = (delay_s + by * ends[1] - gate.phase_s) % gate.period_s < gate.width_s
        lit = of_pulse * moved * seen
        mass = lit + steady / fine * opened
        first = -np.exp(mass - np.cumsum(mass, axis=-1)) * np.expm1(-mass)
        if responses:
            kinds = [first]
            if len(responses) > 1:
                share = np.divide(lit, mass, out=np.zeros_like(mass), where=mass > 0)
                kinds = [share * first, (1 - share) * first]
            pairs = zip(kinds, responses, strict=True)
            spectrum = sum(np.fft.rfft(kind) * response for kind, response in pairs)
            first = np.asarray(np.fft.irfft(spectrum, first.shape[-1]))
        shares[pixels] = first.reshape(len(first), tcspc.bins, parts).sum(axis=-1).clip(0)
    return shares.reshape(*arrivals.shape[:-1], tcspc.bins)


def _response(ends: Floats, period_s: float, jitter: Jitter) -> Floats:
    """Shares of time stamps by how many parts of a bin they are late, around the period."""
    middle = ends - (ends[1] - ends[0]) / 2
    late = jitter.tail_share if jitter.tail_s > 0 else 0.0
    prompt = _wrapped(middle, jitter.sigma_s, 0.0, period_s)
    tail = _wrapped(middle, jitter.sigma_s, jitter.tail_s, period_s) if late else prompt
    return np.asarray((1 - late) * prompt + late * tail)


def _wrapped(ends: Floats, sigma_s: float, decay_s: float, period_s: float) -> Floats:
    """Shares between times that a pulse and those before it have, of a pulse at 0."""
    longest = _FARTHEST * sigma_s + _LATEST * decay_s + ends[-1] - ends[0]
    first = int(np.floor((-_FARTHEST * sigma_s - ends[-1]) / period_s))
    last = int(np.ceil((longest - ends[0]) / period_s))
    total = np.zeros(len(ends))
    for number in range(first, last + 1):
        total += _cumulative(ends + number * period_s, sigma_s, decay_s)
    shares = np.diff(total)
    return np.asarray(shares / shares.sum())


def _cumulative(times: Floats, sigma_s: float, decay_s: float) -> Floats:
    from scipy.stats import expon, exponnorm, norm  # slow to load

    if sigma_s == 0 and decay_s == 0:
        return (times > 0).astype(np.float64)
    if decay_s <= _SHORT * sigma_s:  # where SciPy's exponnorm loses all digits
        return np.asarray(norm.cdf((times - decay_s) / sigma_s))
    if sigma_s <= _SHORT**2 * decay_s:
        return np.asarray(expon.cdf(times / decay_s))
    return np.asarray(exponnorm.cdf(times / sigma_s, decay_s / sigma_s))


def sorted_in_time(
    times_s: Floats, pixels: NDArray[np.integer], number: int, tcspc: Tcspc, late_s: Any = 0.0
) -> Ints:
    """Return the histogram (number, bins) of the first event of each pixel in each period.

    Times count from the start of a period; events need no order. `late_s`: by which stamps of the
    events come later, within the period.
    """
    order = np.argsort(times_s, kind="stable")
    period = np.floor(times_s[order] / tcspc.period_s).astype(np.int64)
    pixel = pixels[order].astype(np.int64)
    first = np.unique(period * number + pixel, return_index=True)[1]
    within = ((times_s + late_s)[order][first] / tcspc.period_s - period[first]) % 1
    place = np.minimum((within * tcspc.bins).astype(np.int64), tcspc.bins - 1)
    counts = np.bincount(pixel[first] * tcspc.bins + place, minlength=number * tcspc.bins)
    return counts.reshape(number, tcspc.bins)
