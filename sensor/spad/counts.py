"""Counts of a frame whose distribution has no closed form; closed forms are drawn in `array`.

Counts are simulated avalanche by avalanche (`simulation`), but drawn from mean and variance in
bright light (`draw_matched`).
"""

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.core.errors import UserError
from megalopta.sensor.effects import dead_time
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.spad.distributions import draw_matched
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.moments import count_moments, mean_rate, open_rate
from megalopta.sensor.spad.simulation import simulate_frame

SIMULATED_EVENTS, FEWEST_MATCHED = 5e3, 100.0
"""Events of a pixel without crosstalk above which only their mean and variance are used; fewer
where a frame would take too long."""
MOST_SIMULATED = 4e8
"""Most events of a frame that are simulated one by one, in about half a minute."""


def draw_frame(
    rng: np.random.Generator,
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None = None,
) -> Ints:
    """Draw the counts of one exposure whose distribution has no closed form.

    Raises UserError for light in which it takes too long.

    Parameters
    ----------
    rate_hz : (rows, columns) or (S, rows, columns) float64
        Rate of detectable photons plus dark counts; constant, or in S equal parts of the exposure.
    maps : AvalancheMaps, optional
        Differences between pixels; default: none.
    """
    dead_time.check_arrivals(rate_hz, exposure_s)
    counted, simulated = _load(rate_hz, exposure_s, effects, maps)
    is_coupled = effects.crosstalk.is_on
    is_bright = (counted > SIMULATED_EVENTS) & (not is_coupled)
    if simulated[~is_bright].sum() > MOST_SIMULATED:
        is_bright = (counted > FEWEST_MATCHED) | is_coupled
    counts = np.empty(counted.shape, np.int64)
    for chosen in (is_bright, ~is_bright):
        if not chosen.any():
            continue
        some_hz, some_maps = rate_hz, maps
        if not chosen.all():
            # pixels of a frame with a single row, as they do not meet
            some_hz = rate_hz[..., None, chosen]
            some_maps = maps and AvalancheMaps(*(factor[None, chosen] for factor in maps))
        if chosen is is_bright:
            try:
                mean, variance = count_moments(some_hz, exposure_s, effects, some_maps)
            except UserError as error:
                raise UserError(
                    f"about {simulated.max():.2g} events in a pixel, of {rate_hz.max():.2g} "
                    "detections and dark counts per second, are too many to simulate, and their "
                    "mean and variance are not known: lower the light or exposure_s"
                ) from error
            counts[chosen] = draw_matched(rng, mean.ravel(), variance.ravel())
        else:
            check_load(some_hz, exposure_s, effects, some_maps)
            frame = simulate_frame(
                rng, some_hz, exposure_s, effects, maps=some_maps, keep_events=False
            )
            counts[chosen] = frame.counts.ravel()
    return counts


def check_load(
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None,
    most: float = MOST_SIMULATED,
) -> None:
    """Raise UserError for light in which a frame takes too long to simulate event by event."""
    load = _load(rate_hz, exposure_s, effects, maps)[1].sum()
    if load > most:
        raise UserError(
            f"about {load:.2g} events in a frame, of up to {rate_hz.max():.2g} detections and dark "
            f"counts per second in a pixel, are to be simulated one by one, more than {most:.0e}: "
            "lower the light, or use a shorter exposure_s or fewer pixels"
        )


def _load(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, maps: AvalancheMaps | None
) -> tuple[Floats, Floats]:
    """Most counts of each pixel (rows, columns), and events that a simulation takes up."""
    mean_hz = mean_rate(rate_hz, exposure_s, effects) if rate_hz.ndim == 3 else rate_hz
    arrivals = open_rate(mean_hz, exposure_s, effects) * exposure_s
    dead = effects.dead_time
    dead_s = dead.dead_time_s * (1.0 if maps is None else maps.dead_time)
    counted = simulated = arrivals
    if not dead.is_on:
        counted = simulated = arrivals / (1 - effects.afterpulsing.mean_carriers)
    elif dead.kind == "nonparalyzable" and not effects.crosstalk.is_on:
        counted = np.minimum(arrivals, 1 + exposure_s / dead_s)
        # arrivals that a recharging pixel does not count
        lost = 1 + 1.3 * np.sqrt(mean_hz * dead.recharge_s)
        simulated = np.minimum(arrivals, lost * counted)
    if dead.start == "stationary":
        simulated = simulated * (1 + (effects.memory_s + 20 * np.max(dead_s)) / exposure_s)
    return counted, simulated
