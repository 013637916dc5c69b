"""Moments of the counts of one pixel by simulation, at fixed rates, kept on disk.

Simulations run once, at 8 rates to the decade, and from fixed streams, so that the moments of a
rate do not depend on what else is asked for. Of an exposure much longer than what a pixel remembers
only a beginning is simulated; after it counts grow evenly.

With the 0.2 s of computing that a rate is given, the standard error is below `MEAN_ERROR` in the
mean and `VARIANCE_ERROR` in the variance, as long as a pixel remembers fewer than 100 arrivals. It
is larger, some percent, where hardly any arrival is counted: beyond r·τ = 5 with paralyzable dead
time, or less than 0.1 counts an exposure after a stationary start.

Tables lie in the user's cache folder under the hash of the effects, the exposure and the code that
makes them. A folder that cannot be written to, or a damaged file, costs time and nothing else.
Other tables of sensors are made in less time than they would take to be written.
"""

from collections.abc import Callable
from functools import lru_cache
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats
from megalopta.core.folders import cache_folder
from megalopta.core.freshness import code_digest, digest
from megalopta.sensor.avalanches.simulation import simulate_counts, simulate_events
from megalopta.sensor.effects.fields import AvalancheEffects
from megalopta.sensor.sampling.streams import generator

NODES_PER_DECADE = 8
MEAN_ERROR, VARIANCE_ERROR = 3e-3, 1.5e-2
"""Relative standard errors of what is interpolated."""

_BUDGET_NS = 2e8
_NS_PER_EXPOSURE, _NS_PER_ARRIVAL, _NS_PER_COUNT = 100, 4, 30
_FEWEST_EXPOSURES = 16
_ARRIVALS_OF_A_PIECE = 25
_DEAD_TIMES_REMEMBERED = 20
# of the memory for a part in e²⁰, which is more than a covariance needs
_PART_OF_MEMORY = 0.25
_MOST_BYTES = 10**8
"""Of all tables; one takes a few kB."""
_CODE = tuple(f"megalopta.sensor.{room}" for room in ("avalanches", "effects", "sampling"))
_one_at_a_time = Lock()

Law = Callable[[Floats], tuple[Floats, Floats]]
Table = dict[int, tuple[float, float]]


def moment_ratios(
    nodes: NDArray[np.int64], exposure_s: float, effects: AvalancheEffects, law: Law
) -> Floats:
    """Ratios of mean and of variance to those of a law, at 10^(node/8) arrivals an exposure.

    Parameters
    ----------
    nodes : (N,) int64
    exposure_s : float
    effects : AvalancheEffects
        Crosstalk is left out.
    law : function
        Of rates (n,) in Hz, to mean and variance (n,).

    Returns
    -------
    (N, 2) float64
    """
    effects = effects.without_crosstalk
    # one thread fills the table, which the others would only fill with the same numbers
    with _one_at_a_time:
        store, table = _table(effects, exposure_s)
        missing = [int(node) for node in nodes if int(node) not in table]
        for node in missing:
            table[node] = _ratios(node, exposure_s, effects, law)
        if missing:
            known = np.array(sorted(table))
            store.write({"nodes": known, "ratios": np.array([table[node] for node in known])})
    return np.array([table[int(node)] for node in nodes]).reshape(-1, 2)


@lru_cache(maxsize=256)
def _table(effects: AvalancheEffects, exposure_s: float) -> tuple[ArrayStore, Table]:
    key = digest(effects.model_dump_json(), repr(exposure_s), code_digest(*_CODE))
    store = ArrayStore(cache_folder() / "moments", key, _MOST_BYTES)
    kept = store.read(["nodes", "ratios"])
    if kept is None:
        return store, {}
    rows = zip(kept["nodes"].tolist(), kept["ratios"].tolist(), strict=True)
    return store, {node: (mean, variance) for node, (mean, variance) in rows}


def _ratios(
    node: int, exposure_s: float, effects: AvalancheEffects, law: Law
) -> tuple[float, float]:
    rate_hz = 10 ** (node / NODES_PER_DECADE) / exposure_s
    means, variances = law(np.array([rate_hz]))
    mean, variance = _simulated_moments(
        generator(0, "moments", node), rate_hz, exposure_s, effects, float(means[0]) / exposure_s
    )
    # nothing is counted, or always the same, only where light is overwhelming
    return (
        mean / float(means[0]) if means[0] > 0 else 1.0,
        variance / float(variances[0]) if variances[0] > 0 else 1.0,
    )


def _simulated_moments(
    rng: np.random.Generator,
    rate_hz: float,
    exposure_s: float,
    effects: AvalancheEffects,
    counts_hz: float,
) -> tuple[float, float]:
    """Simulate a beginning and a piece after it; further pieces are like this one.

    A piece is so long that only neighboring ones are correlated, and holds whole gate periods.
    """
    dead, gate, memory_s = effects.dead_time, effects.gate, effects.memory_s
    remembered_s = _PART_OF_MEMORY * memory_s + _DEAD_TIMES_REMEMBERED * dead.dead_time_s
    piece_s = max(_ARRIVALS_OF_A_PIECE / rate_hz, remembered_s)
    if gate.period_s:
        piece_s = np.ceil(piece_s / gate.period_s) * gate.period_s
    pieces = max(int(exposure_s / piece_s) - 1, 1)
    beginning_s = exposure_s - pieces * piece_s
    simulated_s = exposure_s if pieces == 1 else beginning_s + piece_s
    run_up_s = memory_s + remembered_s if dead.start == "stationary" else 0.0
    ns_per_s = _NS_PER_ARRIVAL * rate_hz + _NS_PER_COUNT * counts_hz
    ns_per_exposure = _NS_PER_EXPOSURE + ns_per_s * (simulated_s + run_up_s)
    rates = np.full((max(int(_BUDGET_NS / ns_per_exposure), _FEWEST_EXPOSURES), 1), rate_hz)
    if pieces == 1:
        counts = simulate_counts(rng, rates, exposure_s, effects)
        return float(counts.mean()), float(counts.var())
    times, pixels = simulate_events(rng, rates, simulated_s, effects)
    is_later = times >= beginning_s
    begun, later = (
        np.bincount(pixels[chosen], minlength=rates.size) for chosen in (~is_later, is_later)
    )
    (begun_var, covariance), (_, later_var) = np.cov(begun, later, ddof=0)
    mean = begun.mean() + pieces * later.mean()
    return float(mean), float(begun_var + pieces * (later_var + 2 * covariance))
