"""Counting statistics against `brute_force`: dead time, afterpulsing, gating, alone and together.

Rates r·τ of 0.01, 0.1, 1 and 5, mean counts of 1, 30 and 300, a live and a stationary start. A row
shows the worst of these twelve. How close the laws are is measured by `check_distances`.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Literal

import numpy as np

from megalopta.sensor.avalanches import draw_counts
from megalopta.sensor.effects import Afterpulsing, AvalancheEffects, DeadTime, Gate
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.brute_force import brute_force_counts
from megalopta.sensor.selfcheck.comparison import Check, Counts, Row, two_sample_z, worst_of_each

RATE_TIMES_DEAD_TIME = (0.01, 0.1, 1.0, 5.0)
MEAN_COUNTS = (1.0, 30.0, 300.0)
DEAD_TIME_S = 1e-6
AFTERPULSING = Afterpulsing(mean_carriers=0.2, delay_s=2e-6)
GATE = Gate(period_s=7e-6, width_s=3e-6, phase_s=5e-6)

Kind = Literal["ideal", "nonparalyzable", "paralyzable"]
Start = Literal["live", "stationary"]
_UNGATED = Gate()


def effects_of(
    kind: Kind, start: Start, afterpulsing: Afterpulsing, gate: Gate = _UNGATED
) -> AvalancheEffects:
    """Dead time of 1 µs and what goes with it."""
    law = DeadTime(kind=kind, dead_time_s=DEAD_TIME_S * (kind != "ideal"), start=start)
    return AvalancheEffects(dead_time=law, afterpulsing=afterpulsing, gate=gate)


def operating_point(kind: Kind, rate_times_dead_time: float, counts: float) -> tuple[float, float]:
    """Rate, Hz, and exposure, s, for so many counts on average, afterpulses apart."""
    a = rate_times_dead_time
    counted = {"ideal": 1.0, "nonparalyzable": 1 / (1 + a), "paralyzable": np.exp(-a)}[kind]
    rate = a / DEAD_TIME_S
    return rate, counts / (rate * counted)


def samples(
    effects: AvalancheEffects, rate_hz: float, exposure_s: float, exposures: int
) -> tuple[Counts, Counts]:
    """Counts (exposures,) by brute force and by the way that frames are drawn."""
    plain = brute_force_counts(generator(1, "brute force"), rate_hz, exposure_s, effects, exposures)
    rates = np.full((exposures, 1), rate_hz)
    return plain, draw_counts(generator(2, "drawn"), rates, exposure_s, effects).ravel()


def counting_checks(arrivals: float = 6e5) -> tuple[Check, ...]:
    """Checks that spend about so many arrivals on each of their twelve points."""
    kinds: tuple[Kind, ...] = ("ideal", "nonparalyzable", "paralyzable")
    starts: tuple[Start, ...] = ("live", "stationary")
    ungated = [
        (f"{kind} dead time, {start} start{extra}", effects_of(kind, start, traps), kind)
        for kind, start, (extra, traps) in product(
            kinds, starts, (("", Afterpulsing()), (", afterpulsing", AFTERPULSING))
        )
    ]
    gated = [
        (
            f"{kind} dead time, gate, afterpulsing",
            effects_of(kind, "live", AFTERPULSING, GATE),
            kind,
        )
        for kind in kinds
    ]
    return tuple(
        partial(_worst_rows, term, effects, kind, arrivals)
        for term, effects, kind in ungated + gated
    )


def _worst_rows(term: str, effects: AvalancheEffects, kind: Kind, arrivals: float) -> Iterator[Row]:
    rows: list[tuple[Row, Row, Row]] = []
    for a, counts in product(RATE_TIMES_DEAD_TIME, MEAN_COUNTS):
        rate, exposure = operating_point(kind, a, counts)
        run_up = 300 * a if effects.dead_time.start == "stationary" else 0
        exposures = int(min(max(arrivals / (rate * exposure + run_up), 200), 200_000))
        plain, drawn = samples(effects, rate, exposure, exposures)
        mean_z, variance_z, law_z = two_sample_z(plain, drawn)
        where = f"(worst: r·τ {a:g}, {counts:g} counts)"
        rows.append(
            (
                Row(term, f"mean {where}", plain.mean(), drawn.mean(), mean_z),
                Row(term, f"variance {where}", plain.var(), drawn.var(), variance_z),
                Row(term, f"law, as z {where}", 0.0, law_z, law_z),
            )
        )
    yield from worst_of_each(rows)
