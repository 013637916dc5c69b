"""Mean and variance of counts with crosstalk besides dead time, afterpulses or twilight.

Light from a neighbor j arrives in pixel i at the time of an avalanche in j. For a dead time before,
j did not fire: it has not just fired i, nor i it. With c the probability that j fires i, ν the
count rate and λ a pixel's own rate, i receives from j

    m_ij = c·(ν_j − c·q_ji·ν_i)

because light from an avalanche that i has just fired in j returns while i is dead. An arrival finds
i live with probability q_ij, against ℓ_i at any time. For the two kinds of dead time

    non-paralyzable   ℓ_i = 1 − ν_i·τ    q_ij = 1/(1 + (1 − c)·b/(1 − b)),  b = dead without j's
                                         light = ν_i·τ − m_ij·q_ij·τ/(1 + λ_i·τ)
    paralyzable       q_ij/ℓ_i = exp(m_ij·τ + c·ν_i·τ)

The counts are those of a single pixel at r_i = λ_i + Σ_j m_ij·q_ij/ℓ_i. With paralyzable dead time
they are those at λ_i + Σ_j m_ij, whose arrivals extend it, times r_i over that. Early in an
exposure τ is at most the time elapsed.

For the variance every pixel responds linearly to its neighbors' light
(`crosstalk.spread_variance`), with the slope and Fano factor of a pixel without the light of the
neighbor in question. A pixel with dead time is not fired again by avalanches that it caused.
Without dead time, this is exact in long exposures.

Neglected: light that reaches a pixel at one instant by two paths, and that the sub-Poisson
statistics of neighbors' light also change how it meets dead times.

Against simulations of a uniform frame, the mean is within 0.1 % and the variance within 0.5 % at
0.1 fired neighbors, 0.3 % and 0.6 % at 0.3, 1.3 % and 2.5 % at 0.6, for r·τ from 1e-3 to 1 and both
kinds of dead time; likewise, to the 1 % of their simulations, for a bright pixel, its neighbors and
a border of dark and bright. Errors of the tables of a single pixel add. Up to 0.3 fired neighbors,
the same holds for the mean at r·τ from 1 to 100 in 50 to 1000 dead times, and the variance is
within 5 % or 0.02.
"""

from collections.abc import Callable

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.sensor.effects import crosstalk
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.gating import open_fraction
from megalopta.sensor.spad.model import AvalancheEffects

MOST_COUPLED, MOST_FIRED = 1.1, 0.3
"""Largest rate times dead time at which moments with stronger crosstalk than this are stated."""
_ROUNDS, _SETTLED = 80, 1e-7

Moments = tuple[Floats, Floats]


def coupled_moments(
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None,
    pixel_moments: Callable[[Floats, float, AvalancheEffects, AvalancheMaps | None], Moments],
) -> Moments:
    """Mean and variance of the counts of a (rows, columns) frame, from those without crosstalk.

    Raises UserError for strong crosstalk in bright light.
    """
    alone, kind = effects.replaced(crosstalk=crosstalk.Crosstalk()), effects.dead_time.kind
    dead_s = effects.dead_time.dead_time_s * (np.ones((1, 1)) if maps is None else maps.dead_time)
    strength = None if maps is None else maps.crosstalk
    fired = effects.crosstalk.most_fired * (1.0 if strength is None else float(strength.max()))
    if fired > MOST_FIRED and float(rate_hz.max(initial=0)) * dead_s.max() > MOST_COUPLED:
        raise UserError(
            f"crosstalk that fires {fired:.2g} neighbors: mean and variance are stated up to "
            f"{MOST_COUPLED / dead_s.max():.3g} detections and dark counts per second in a pixel; "
            f"the brightest has {rate_hz.max():.3g}: lower the light, or ask for no expectation"
        )
    open_s = exposure_s * open_fraction(effects.gate, exposure_s)
    # mean look-back time: τ, or less near the start of the exposure
    if effects.dead_time.start != "stationary":
        early_s = dead_s * (1 - dead_s / (2 * exposure_s))
        dead_s = np.where(dead_s < exposure_s, early_s, exposure_s / 2)
    dead_s = np.broadcast_to(dead_s, rate_hz.shape)
    mean, _ = pixel_moments(rate_hz, exposure_s, alone, maps)
    for _ in range(_ROUNDS):
        mean_before = mean
        received_hz, effective_hz, squares = _light(
            rate_hz, mean / open_s, dead_s, effects, strength
        )
        # light that extends a dead time, or finds the pixel live
        light_hz = received_hz if kind == "paralyzable" else effective_hz
        arrivals_hz = rate_hz + light_hz
        mean, _ = pixel_moments(arrivals_hz, exposure_s, alone, maps)
        if kind == "paralyzable":
            mean = mean * _ratio(rate_hz + effective_hz, arrivals_hz)
        if np.allclose(mean, mean_before, rtol=_SETTLED, atol=1e-300):
            break
    # without the light of the neighbor in question: for all arrivals, and for those of neighbors
    typical_hz = np.maximum(arrivals_hz - _ratio(squares, arrivals_hz), 0.0)
    typical_mean, variance = pixel_moments(typical_hz, exposure_s, alone, maps)
    others_hz = np.maximum(arrivals_hz - _ratio(squares, light_hz), 0.0)
    step_hz = np.maximum(others_hz, 1e-3 / open_s) * 1e-3  # 0.1 % for the slope
    more, less = (
        pixel_moments(others_hz + sign * step_hz, exposure_s, alone, maps)[0] for sign in (1, 0)
    )
    gain = (more - less) / (step_hz * open_s)
    drawn = mean * np.where(typical_mean > 0, _ratio(variance, typical_mean), 1.0)
    returns = not effects.dead_time.is_on
    spread = crosstalk.spread_variance(drawn, mean, effects.crosstalk, strength, gain, returns)
    return mean, np.maximum(spread, 0.0)


def _light(
    rate_hz: Floats,
    counts_hz: Floats,
    dead_s: Floats,
    effects: AvalancheEffects,
    strength: Floats | None,
) -> tuple[Floats, Floats, Floats]:
    """Arrivals per second from all neighbors, these weighted with q/ℓ, and the sum of squares."""
    kind, shape = effects.dead_time.kind, rate_hz.shape
    chances = crosstalk.neighborhoods(effects.crosstalk)
    reach = np.array(chances.shape[2:]) // 2
    sent = np.ones(shape) if strength is None else strength
    received_hz, effective_hz, squares = (np.zeros(shape) for _ in range(3))

    def padded(values: Floats) -> Floats:
        wide = np.full(np.add(shape, 2 * reach), 0.0)
        wide[reach[0] : reach[0] + shape[0], reach[1] : reach[1] + shape[1]] = values
        return wide

    wide_counts_hz, wide_rate_hz, wide_dead_s = map(padded, (counts_hz, rate_hz, dead_s))
    for place in crosstalk.places_fired(chances):
        opposite = 2 * reach - place
        neighbors = tuple(
            slice(start, start + size) for start, size in zip(opposite, shape, strict=True)
        )
        to, back = (
            crosstalk.of_pixels(chances[:, :, row, column], shape) * sent
            for row, column in (place, opposite)
        )
        their_counts_hz, to = wide_counts_hz[neighbors], padded(to)[neighbors]
        light_hz = to * their_counts_hz
        if kind != "ideal":
            their_rate_hz, their_dead_s = wide_rate_hz[neighbors], wide_dead_s[neighbors]
            q_back = _live(kind, their_counts_hz, their_rate_hz, back * counts_hz, to, their_dead_s)
            light_hz = np.maximum(light_hz - to * back * q_back * counts_hz, 0.0)
        met_hz = light_hz
        if kind == "nonparalyzable":
            q = _live(kind, counts_hz, rate_hz, light_hz, back, dead_s)
            met_hz = light_hz * (q / np.maximum(1 - counts_hz * dead_s, 1e-3))
        elif kind == "paralyzable":
            exponent = (light_hz + back * counts_hz) * dead_s
            met_hz = light_hz * np.exp(np.minimum(exponent, 20.0))
        received_hz += light_hz
        effective_hz += met_hz
        squares += (light_hz if kind == "paralyzable" else met_hz) ** 2
    return received_hz, effective_hz, squares


def _live(
    kind: str, counts_hz: Floats, rate_hz: Floats, light_hz: Floats, back: Floats, dead_s: Floats
) -> Floats:
    """Probability q that a pixel is live when a neighbor that sends it this light fires."""
    if kind == "paralyzable":
        return np.exp(-np.minimum((rate_hz + np.maximum(light_hz, 0)) * dead_s, 700.0))
    dead = np.maximum(counts_hz - light_hz / (1 + rate_hz * dead_s), 0.0) * dead_s
    dead = np.minimum(dead, 0.999)
    return np.asarray(1 / (1 + (1 - back) * dead / (1 - dead)))


def _ratio(above: Floats, below: Floats) -> Floats:
    return np.divide(above, below, out=np.zeros_like(above), where=below > 0)
