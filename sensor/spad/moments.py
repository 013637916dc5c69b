"""Mean and variance of the counts of one pixel, without crosstalk.

    dead time alone, gate alone    closed forms (`dead_time`)
    anything else                  simulated at fixed rates, interpolated

Simulations run once, at 5 rates per decade, from fixed random streams: the moments of a rate do not
depend on other requests. Interpolated is the logarithm of the ratio to the moments of dead time at
the same arrivals, over the logarithm of the rate. Of an exposure much longer than a pixel's memory,
only the beginning and one later piece are simulated; that piece is repeated.

Two control variates have known moments: the photons and dark carriers that meet a live pixel, less
their mean given its live time, and the trapped carriers, less their mean. Both have mean 0 and
Poisson variance. Only the rest has the error of a simulation: up to `MEAN_ERROR`, or 0.003 standard
deviations, and `VARIANCE_ERROR`, with up to 0.2 carriers. Errors are twice as large with
paralyzable dead time, and some percent there beyond r·τ = 2.

Where pixels differ (`AvalancheMaps`), a polynomial interpolates ratios at some factors between the
smallest and the largest.

Tables are cached in the user's cache folder under the hash of effects, exposure and code. A
read-only folder or a damaged file costs only time.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from threading import Lock
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats
from megalopta.core.folders import cache_folder
from megalopta.core.freshness import code_digest, digest
from megalopta.sensor.effects import dead_time
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.dead_time import check_arrivals
from megalopta.sensor.effects.gating import open_fraction
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.simulation import SimulatedFrame, simulate_frame

MEAN_ERROR, VARIANCE_ERROR = 1e-3, 1e-2
"""Relative errors of the interpolation."""

_NODES_PER_DECADE = 5
_FEWEST_ARRIVALS = 0.1
_FACTORS = 3
_BUDGET_NS = 4e7
_NS_PER_EXPOSURE, _NS_PER_ARRIVAL, _NS_PER_COUNT = 100, 4, 30
_FEWEST_EXPOSURES, _FEWEST_CARRIERS = 16, 1000
_ARRIVALS_OF_A_PIECE = 25
_DEAD_TIMES_REMEMBERED = 20
# of the memory for a part in e²⁰, which is more than a covariance needs
_PART_OF_MEMORY = 0.25
_MOST_BYTES = 10**8
"""Size limit of all tables; one takes a few kB."""
_CODE = tuple(
    f"megalopta.sensor.{module}"
    for module in ("spad.kernel", "spad.simulation", "spad.moments", "effects", "sampling")
)
_one_at_a_time = Lock()

Moments = tuple[Floats, Floats]
Table = dict[int, tuple[float, float]]


def pixel_moments(
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None = None,
) -> Moments:
    """Return mean and variance of the counts of one exposure, without crosstalk.

    Parameters
    ----------
    rate_hz : array of any shape
        Rate of arrivals while the gate is open.
    maps : AvalancheMaps, optional
        Differences between pixels, of the same shape; default: none.
    """
    check_arrivals(rate_hz, exposure_s)
    scale = 1.0 if maps is None else maps.dead_time
    open_hz = open_rate(rate_hz, exposure_s, effects)
    mean, variance = dead_time.moments(open_hz, exposure_s, effects.dead_time, scale)
    on = effects.on - {"crosstalk"}
    if len(on) < 2 and on <= {"dead_time", "gate"} and effects.dead_time.has_law:
        return mean, variance
    ratio_of_means, ratio_of_variances = _over_factors(
        lambda each: _ratios(rate_hz * exposure_s, exposure_s, each),
        effects.without_crosstalk,
        maps,
    )
    return mean * ratio_of_means, variance * ratio_of_variances


def open_rate(rate_hz: Floats, exposure_s: float, effects: AvalancheEffects) -> Floats:
    """Rate of a pixel without a gate that has the same number of arrivals, Hz."""
    return rate_hz * open_fraction(effects.gate, exposure_s) if effects.gate.is_on else rate_hz


def _over_factors(
    ratios: Callable[[AvalancheEffects], Floats],
    effects: AvalancheEffects,
    maps: AvalancheMaps | None,
) -> Floats:
    """Ratios (2, ...) for pixels with their own dead time and number of carriers."""
    if maps is None:
        return ratios(effects)
    total = np.zeros((2, *maps.dead_time.shape))
    for dead_factor, of_dead in _factors(maps.dead_time, effects.dead_time.is_on):
        for factor, of_traps in _factors(maps.afterpulsing, effects.afterpulsing.is_on):
            each = effects.model_copy(
                update={
                    "dead_time": _scaled(effects.dead_time, "dead_time_s", dead_factor),
                    "afterpulsing": _scaled(effects.afterpulsing, "mean_carriers", factor),
                }
            )
            total += of_dead * of_traps * ratios(each)
    return total


def _scaled(effect: Any, field: str, factor: float) -> Any:
    return effect.model_copy(update={field: getattr(effect, field) * factor})


def _factors(factors: Floats, is_on: bool) -> list[tuple[float, Floats]]:
    """Nodes of a polynomial over a factor, and each pixel's weight of each node (Lagrange)."""
    low, high = float(factors.min(initial=np.inf)), float(factors.max(initial=0))
    if not is_on or not factors.size:
        return [(1.0, np.ones_like(factors))]
    if high - low <= 1e-9 * high:
        return [(high, np.ones_like(factors))]
    nodes = np.linspace(low, high, _FACTORS).tolist()
    return list(zip(nodes, lagrange(factors, nodes), strict=True))


def lagrange(x: Floats, nodes: Sequence[float]) -> list[Floats]:
    """Return the weight of each node in a polynomial through the values at all of them."""
    return [
        np.prod([(x - other) / (node - other) for other in nodes if other != node], axis=0)
        for node in nodes
    ]


def _ratios(arrivals: Floats, exposure_s: float, effects: AvalancheEffects) -> Floats:
    """Ratios (2, ...) of mean and variance to those of dead time at these arrivals."""
    place = np.log10(np.maximum(arrivals, _FEWEST_ARRIVALS)) * _NODES_PER_DECADE
    # a slope uses the adjacent nodes; those beyond change nothing
    ends = int(np.floor(place.min(initial=0))) - 1, int(np.floor(place.max(initial=0))) + 3
    nodes = np.arange(*ends)
    table = _table(tuple(nodes.tolist()), exposure_s, effects)
    return np.moveaxis(np.exp(PchipInterpolator(nodes, np.log(table))(place)), -1, 0)


def _table(nodes: tuple[int, ...], exposure_s: float, effects: AvalancheEffects) -> Floats:
    """Ratios (N, 2) at 10^(node/5) arrivals per exposure."""
    # one thread fills the table: others would repeat its work
    with _one_at_a_time:
        store, table = _stored(effects, exposure_s)
        missing = [node for node in nodes if node not in table]
        for node in missing:
            table[node] = _simulated_ratios(node, exposure_s, effects)
        if missing:
            known = np.array(sorted(table))
            store.write({"nodes": known, "ratios": np.array([table[node] for node in known])})
    return np.array([table[node] for node in nodes])


@lru_cache(maxsize=256)
def _stored(effects: AvalancheEffects, exposure_s: float) -> tuple[ArrayStore, Table]:
    key = digest(effects.model_dump_json(), repr(exposure_s), code_digest(*_CODE))
    store = ArrayStore(cache_folder() / "moments", key, _MOST_BYTES)
    kept = store.read(["nodes", "ratios"])
    if kept is None:
        return store, {}
    rows = zip(kept["nodes"].tolist(), kept["ratios"].tolist(), strict=True)
    return store, {node: (mean, variance) for node, (mean, variance) in rows}


def _simulated_ratios(
    node: int, exposure_s: float, effects: AvalancheEffects
) -> tuple[float, float]:
    rate_hz = np.array([10 ** (node / _NODES_PER_DECADE) / exposure_s])
    open_hz = open_rate(rate_hz, exposure_s, effects)
    laws = np.ravel(dead_time.moments(open_hz, exposure_s, effects.dead_time))
    rng = generator(0, "moments", node)
    found = _simulated_moments(rng, float(rate_hz[0]), exposure_s, effects, laws[0] / exposure_s)
    # counts are 0 or constant only under overwhelming light
    mean, variance = (
        ours / law if min(ours, law) > 0 else 1.0 for ours, law in zip(found, laws, strict=True)
    )
    return mean, variance


def _simulated_moments(
    rng: np.random.Generator,
    rate_hz: float,
    exposure_s: float,
    effects: AvalancheEffects,
    counts_hz: float,
) -> tuple[float, float]:
    """Simulate the beginning and one later piece, which represents all further pieces.

    A piece is long enough that only adjacent ones are correlated, and holds whole gate periods.
    """
    dead, gate, memory_s = effects.dead_time, effects.gate, effects.memory_s
    remembered_s = _PART_OF_MEMORY * memory_s + _DEAD_TIMES_REMEMBERED * dead.dead_time_s
    piece_s = max(_ARRIVALS_OF_A_PIECE / rate_hz, remembered_s)
    if gate.period_s:
        piece_s = float(np.ceil(piece_s / gate.period_s)) * gate.period_s
    pieces = max(int(exposure_s / piece_s) - 1, 1)
    beginning_s = exposure_s - pieces * piece_s
    simulated_s = exposure_s if pieces == 1 else beginning_s + piece_s
    ns_per_s = _NS_PER_ARRIVAL * rate_hz + _NS_PER_COUNT * counts_hz
    ns_per_exposure = _NS_PER_EXPOSURE + ns_per_s * simulated_s  # excluding entries before a start
    rates = np.full((max(int(_BUDGET_NS / ns_per_exposure), _FEWEST_EXPOSURES), 1), rate_hz)
    carriers = effects.afterpulsing.mean_carriers
    if pieces == 1:
        whole = simulate_frame(rng, rates, exposure_s, effects, keep_events=False)
        mean, covariance = _moments_of([whole], carriers)
        return float(mean[0]), float(covariance[0, 0])
    begun = simulate_frame(rng, rates, beginning_s, effects, keep_events=False)
    if gate.period_s:
        phase_s = (gate.phase_s - beginning_s) % gate.period_s
        effects = effects.model_copy(update={"gate": gate.model_copy(update={"phase_s": phase_s})})
    later = simulate_frame(rng, rates, piece_s, effects, state=begun.state, keep_events=False)
    mean, covariance = _moments_of([begun, later], carriers)
    variance = covariance[0, 0] + pieces * (covariance[1, 1] + 2 * covariance[0, 1])
    return float(mean[0] + pieces * mean[1]), float(variance)


def _moments_of(frames: list[SimulatedFrame], mean_carriers: float) -> tuple[Floats, Floats]:
    """Mean (F,) and covariance (F, F) of the counts of consecutive exposures.

    The part that is linear in both control variates has known moments.
    """
    counts = np.array([frame.counts.ravel() for frame in frames], np.float64)
    met, expected, trapped = np.array([frame.tally for frame in frames]).swapaxes(0, 1)
    surplus, variance = met - expected, expected.mean(1)
    if trapped.sum() > _FEWEST_CARRIERS:
        surplus = np.concatenate([surplus, trapped - mean_carriers * counts])
        variance = np.concatenate([variance, mean_carriers * counts.mean(1)])
    (shared, *_) = np.linalg.lstsq(_centered(surplus).T, _centered(counts).T, rcond=None)
    rest = counts - shared.T @ surplus
    known = shared.T @ np.diag(variance) @ shared
    return rest.mean(1), np.asarray(np.cov(rest, ddof=0) + known)


def _centered(values: Floats) -> Floats:
    return np.asarray(values - values.mean(axis=1, keepdims=True))
