"""Effects on avalanches that act on each other: simulated and stated against `brute_force`.

Frames of 2 × 3 pixels, uneven light, some of it nearly dark. What is drawn is held against brute
force pixel by pixel; stated means and variances against the mean over many exposures, allowing for
the errors that are stated with them.
"""

from collections.abc import Iterator

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches import (
    MEAN_ERROR,
    VARIANCE_ERROR,
    count_moments,
    draw_counts,
    simulate_frame,
)
from megalopta.sensor.effects import (
    Afterpulsing,
    AvalancheEffects,
    AvalancheMaps,
    Crosstalk,
    DeadTime,
    Gate,
    crosstalk,
)
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.brute_force import brute_force_counts, brute_force_frames
from megalopta.sensor.selfcheck.comparison import (
    Counts,
    Row,
    exact_row,
    mean_row,
    two_sample_z,
    variance_row,
    worst,
    worst_of_each,
    z_rows,
)
from megalopta.sensor.spad import preset

_TAU_S, _EXPOSURE_S = 1e-6, 10e-6
_RATES = 1e6 * np.array([[0.8, 0.3, 0.05], [1.0, 2.0, 0.5]])
_TRAPS = Afterpulsing(mean_carriers=0.3, delay_s=1e-6)
_TALK = Crosstalk(mean_fired_neighbors=0.3, diagonal=0.3, distance_two=0.1)
_GATE = Gate(period_s=3e-6, width_s=2e-6, phase_s=1e-6)
_MAPS = AvalancheMaps(*(np.linspace(low, 2 - low, 6).reshape(2, 3) for low in (0.6, 0.7, 0.1)))
FRAMES = 3000
"""That are drawn; by brute force, which is quicker, four times as many"""
_TABLE_MEAN, _TABLE_VARIANCE = 3e-3, 1.5e-2
TABULATED = "paralyzable, crosstalk, afterpulsing"
"""Of the terms whose stated moments rest on tables, the one that is compared"""

DEAD_TIMES = {
    "no dead time": DeadTime(),
    "non-paralyzable": DeadTime(kind="nonparalyzable", dead_time_s=_TAU_S),
    "paralyzable": DeadTime(kind="paralyzable", dead_time_s=_TAU_S),
    "twilight": DeadTime(kind="nonparalyzable", dead_time_s=_TAU_S, twilight_s=0.2e-6),
    "recharging": DeadTime(kind="nonparalyzable", dead_time_s=_TAU_S, recharge_s=0.3e-6),
}


def check_dead_time_ends() -> Iterator[Row]:
    """Gaps after a dead time: mean rates of twilight pulses and of recharging, closed forms."""
    rate, exposure = 2e6, 200e-6
    for name, dead in list(DEAD_TIMES.items())[3:]:
        running = AvalancheEffects(dead_time=dead.model_copy(update={"start": "stationary"}))
        counts = draw_counts(generator(21, name), np.full((20_000, 1), rate), exposure, running)
        alpha, tau_r = dead.twilight_s, dead.recharge_s
        steps = np.linspace(0, 30e-6, 600_001)
        waits = np.exp(-rate * (steps - (tau_r * -np.expm1(-steps / tau_r) if tau_r else 0)))
        gap = np.exp(-rate * alpha) / rate if alpha else np.trapezoid(waits, steps)
        expected = float(exposure / (_TAU_S + gap))
        yield mean_row(f"dead time, {name}", "counts, running", expected, counts)
        alone = AvalancheEffects(dead_time=dead)
        plain = brute_force_counts(generator(22, name), rate, exposure, alone, 10_000)
        drawn = draw_counts(generator(23, name), np.full((10_000, 1), rate), exposure, alone)
        yield from z_rows(f"dead time, {name}", plain, drawn.ravel())


def check_combinations() -> Iterator[Row]:
    """Every dead time alone and with what acts on it, drawn and stated."""
    for name, dead in DEAD_TIMES.items():
        for extra, traps, gate, talk in (
            ("crosstalk", Afterpulsing(), Gate(), _TALK),
            ("crosstalk, afterpulsing", _TRAPS, Gate(), _TALK),
            ("crosstalk, afterpulsing, gate", _TRAPS, _GATE, _TALK),
        ):
            effects = AvalancheEffects(
                dead_time=dead, afterpulsing=traps, gate=gate, crosstalk=talk
            )
            yield from _against_brute_force(f"{name}, {extra}", effects, None)


def check_delays() -> Iterator[Row]:
    """Many carriers, of which a dead time as long as their delay takes most."""
    traps = Afterpulsing(mean_carriers=0.9, delay_s=_TAU_S)
    for name in ("non-paralyzable", "paralyzable", "twilight"):
        effects = AvalancheEffects(dead_time=DEAD_TIMES[name], afterpulsing=traps)
        plain = brute_force_counts(generator(29, name), 2e5, 20e-6, effects, 200_000)
        drawn = draw_counts(generator(30, name), np.full((200_000, 1), 2e5), 20e-6, effects)
        yield from z_rows(f"{name}, many carriers", plain, drawn.ravel())


def check_dark_neighbor() -> Iterator[Row]:
    """One pixel in the light, one in the dark: what is lost is lost in the first alone.

    Avalanches of the bright one are a dead time apart, so that its neighbor is live at each.
    """
    rates, chance = np.array([[2e6, 0.0]]), _TALK.mean_fired_neighbors / 4
    talk = Crosstalk(mean_fired_neighbors=_TALK.mean_fired_neighbors)
    for name in ("non-paralyzable", "paralyzable"):
        effects = AvalancheEffects(dead_time=DEAD_TIMES[name], crosstalk=talk)
        mean, variance = (part[0] for part in count_moments(rates, 200e-6, effects))
        alone, spread = count_moments(rates[:, :1], 200e-6, effects.without_crosstalk)
        dark = float(chance * alone[0, 0])
        scattered = float(chance**2 * spread[0, 0] + chance * (1 - chance) * alone[0, 0])
        for quantity, expected, stated, tolerance in (
            ("mean, bright", float(alone[0, 0]), mean[0], 2e-4),
            ("mean, dark", dark, mean[1], 5e-3),
            ("variance, bright", float(spread[0, 0]), variance[0], 0.02),
            ("variance, dark", scattered, variance[1], 0.02),
        ):
            term = f"{name}, dark neighbor"
            yield exact_row(term, quantity, expected, float(stated), tolerance * expected)
        strong = AvalancheMaps.alike((1, 2))._replace(crosstalk=np.array([[1.5, 0.0]]))
        rng = generator(31, name)
        lit, unlit = sum(draw_counts(rng, rates, 10e-3, effects, strong)[0] for _ in range(20))
        sent = 1.5 * chance
        z = (unlit - sent * lit) / (sent * (1 - sent) * lit) ** 0.5
        yield Row(term, "half as much crosstalk again", sent, unlit / lit, float(z))


def check_maps() -> Iterator[Row]:
    """Pixels that differ in dead time, afterpulsing and crosstalk."""
    for name in ("non-paralyzable", "paralyzable"):
        dead = AvalancheEffects(dead_time=DEAD_TIMES[name])
        yield from _against_brute_force(f"{name}, map", dead, _MAPS)
        traps = dead.model_copy(update={"afterpulsing": _TRAPS})
        yield from _against_brute_force(f"{name}, afterpulsing, maps", traps, _MAPS)
        full = traps.model_copy(update={"crosstalk": _TALK})
        yield from _against_brute_force(f"{name}, afterpulsing, crosstalk, maps", full, _MAPS)
    alone = AvalancheEffects(crosstalk=_TALK)
    yield from _against_brute_force("crosstalk, map", alone, _MAPS)


def check_running_frames() -> Iterator[Row]:
    """Frames that go on where the one before ended, in light that changes within each."""
    light = np.stack([_RATES, 2 * _RATES[::-1], np.zeros_like(_RATES)])
    for name, dead in DEAD_TIMES.items():
        effects = AvalancheEffects(dead_time=dead, afterpulsing=_TRAPS, crosstalk=_TALK)
        drawn = np.array([_following(light, effects, index) for index in range(FRAMES)])
        plain = brute_force_frames(generator(25, name), light, 2e-6, effects, 4 * FRAMES, frames=3)
        yield from _two_samples(f"free running, {name}", plain[:, 2], drawn[:, 2])


def check_measured_crosstalk() -> Iterator[Row]:
    """Neighbors that one avalanche fires, against the probabilities measured on an array."""
    per_neighbor = 1.03e-3, 1.62e-4, 1.3e-5
    talk = preset("array-12x4").crosstalk
    primaries = np.zeros((9, 9), np.int64)
    primaries[4, 4] = 2_000_000_000
    rng = generator(26)
    fired = np.sum([crosstalk.spread(rng, primaries, talk) for _ in range(4)], 0) / 8e9
    near, corner, _ = per_neighbor
    # and all ways in two steps
    twice = 4 * near * corner, 2 * near**2, near**2 + 2 * corner**2
    for name, place, expected in zip(
        ("orthogonal", "diagonal", "two away"),
        ((4, 5), (5, 5), (4, 6)),
        np.add(per_neighbor, twice),
        strict=True,
    ):
        measured = float(fired[place])
        z = (measured - expected) / (expected / 8e9) ** 0.5
        yield Row("crosstalk, measured array", name, float(expected), measured, float(z))


def _following(light: Floats, effects: AvalancheEffects, index: int) -> list[Counts]:
    rng, state, counts = generator(24, index), None, []
    for _ in range(3):
        frame = simulate_frame(rng, light, 2e-6, effects, state=state, keep_events=False)
        state = frame.state
        counts.append(frame.counts)
    return counts


def _against_brute_force(
    term: str, effects: AvalancheEffects, maps: AvalancheMaps | None
) -> Iterator[Row]:
    rng = generator(27, term)
    drawn = np.array([draw_counts(rng, _RATES, _EXPOSURE_S, effects, maps) for _ in range(FRAMES)])
    plain = brute_force_frames(
        generator(28, term), _RATES, _EXPOSURE_S, effects, 4 * FRAMES, maps=maps
    )[:, 0]
    yield from _two_samples(term, plain, drawn)
    is_tabulated = effects.afterpulsing.is_on or not effects.dead_time.has_law
    # tables cost seconds each
    if not is_tabulated or term == TABULATED:
        yield from _stated(term, plain, effects, maps)


def _stated(
    term: str, plain: Counts, effects: AvalancheEffects, maps: AvalancheMaps | None
) -> Iterator[Row]:
    mean, variance = count_moments(_RATES, _EXPOSURE_S, effects, maps)
    fired = effects.crosstalk.mean_fired_neighbors * bool(effects.on - {"crosstalk"})
    off_by = (
        MEAN_ERROR * fired + _TABLE_MEAN * effects.afterpulsing.is_on,
        VARIANCE_ERROR * fired + _TABLE_VARIANCE * effects.afterpulsing.is_on,
    )
    rows: list[tuple[Row, Row]] = []
    for place in np.ndindex(_RATES.shape):
        counts = plain[:, place[0], place[1]]
        where = f"(worst pixel, {place[0]}, {place[1]})"
        rows.append(
            (
                mean_row(term, f"stated mean {where}", float(mean[place]), counts),
                variance_row(term, f"stated variance {where}", float(variance[place]), counts),
            )
        )
    for kind, error in zip(zip(*rows, strict=True), off_by, strict=True):
        yield worst([_allowing(row, error) for row in kind])


def _allowing(row: Row, error: float) -> Row:
    """Let a stated relative error enter z as five standard errors."""
    if row.z == 0 or error == 0:
        return row
    chance = abs(row.measured - row.expected) / abs(row.z)
    largest = (chance**2 + (error * abs(row.expected) / 2) ** 2) ** 0.5
    z = (row.measured - row.expected) / largest
    return Row(row.term, row.quantity, row.expected, row.measured, z)


def _two_samples(term: str, plain: Counts, drawn: Counts) -> Iterator[Row]:
    rows: list[tuple[Row, Row]] = []
    for place in np.ndindex(plain.shape[1:]):
        first, second = plain[(slice(None), *place)], drawn[(slice(None), *place)]
        mean_z, variance_z, _ = two_sample_z(first, second)
        rows.append(
            (
                Row(term, "mean", first.mean(), second.mean(), mean_z),
                Row(term, "variance", first.var(), second.var(), variance_z),
            )
        )
    yield from worst_of_each(rows)
    yield from z_rows(term, plain.sum((1, 2)), drawn.sum((1, 2)), " of all pixels")
