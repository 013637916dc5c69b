"""The effects one by one against closed forms: light, crosstalk, counters, frames."""

from collections.abc import Iterator

import numpy as np
from scipy.integrate import quad
from scipy.stats import linregress

from megalopta.sensor import changed
from megalopta.sensor.avalanches import draw_counts, simulate_counts, simulate_events
from megalopta.sensor.counters import (
    AnalogCounter,
    DigitalCounter,
    analog_pixels,
    read_analog,
    read_digital,
)
from megalopta.sensor.effects import (
    Afterpulsing,
    AvalancheEffects,
    Crosstalk,
    DarkCounts,
    DeadTime,
    Gate,
    Jitter,
    afterpulsing,
    crosstalk,
    open_fraction,
    stamp,
)
from megalopta.sensor.optics import band_efficiency, photon_flux
from megalopta.sensor.readout import expose_binary, expose_events, histogram, unpack
from megalopta.sensor.sampling import draw_poisson, generator
from megalopta.sensor.selfcheck.comparison import (
    Row,
    exact_row,
    law_z,
    mean_row,
    variance_row,
    worst_of_each,
)
from megalopta.sensor.spad import expose_rate, preset, without

_UM2 = 1e-12


def check_light() -> Iterator[Row]:
    """Photon flux of the thesis's check figure; band efficiency against numerical integration."""
    flux = photon_flux([17.5e-9 / 100e-6 / 0.02], [(449.99, 450.01)]).sum() * _UM2
    yield exact_row("light", "17.5 nW on 100 mm², 450 nm (photons/µm²/s)", 396.4, flux, 0.1)
    curve = preset("spadcam").efficiency
    points = [wavelength for wavelength in curve.wavelengths_nm if 400 < wavelength < 700]
    detected, _ = quad(lambda nm: float(curve(np.array(nm))) * nm, 400, 700, points=points)
    yield exact_row(
        "efficiency",
        "mean over 400–700 nm",
        detected / ((700**2 - 400**2) / 2),
        float(band_efficiency(curve, [(400.0, 700.0)])[0]),
        1e-9,
    )


def check_afterpulsing() -> Iterator[Row]:
    """Multiplication of counts, and its loss to dead time."""
    exposures, p, delay_s = 40_000, 0.3, 1e-6
    traps = Afterpulsing(mean_carriers=p, delay_s=delay_s)
    running = DeadTime(start="stationary")
    rate_hz, exposure_s = 2e6, 5e-6
    rates = np.full((exposures, 1), rate_hz)
    effects = AvalancheEffects(dead_time=running, afterpulsing=traps)
    counts = simulate_counts(generator(1), rates, exposure_s, effects)
    yield mean_row("afterpulsing", "counts, 1/(1−p) per primary", 10 / (1 - p), counts)
    _, variance = afterpulsing.moments(rate_hz, exposure_s, traps, True)
    yield variance_row("afterpulsing", "variance of counts", float(variance), counts)
    table = Afterpulsing(
        mean_carriers=p, table_delays_s=(0, 1e-6, 4e-6), table_cumulative=(0, 0.5, 1)
    )
    tabulated = effects.model_copy(update={"afterpulsing": table})
    counts = simulate_counts(generator(2), rates, exposure_s, tabulated)
    yield mean_row("afterpulsing", "counts, tabulated delay", 10 / (1 - p), counts)
    # primaries so rare that each cascade runs alone: a carrier survives with e^(−τ/delay)
    dead = DeadTime(kind="nonparalyzable", dead_time_s=delay_s)
    lone = AvalancheEffects(dead_time=dead, afterpulsing=traps)
    counts = simulate_counts(generator(3), np.full((400_000, 1), 1.0), 1.0, lone)
    yield mean_row(
        "afterpulsing", "counts, less those in the dead time", 1 / (1 - p * np.exp(-1)), counts
    )


def check_crosstalk() -> Iterator[Row]:
    """Cascade of one avalanche, edges, and agreement of the two ways to draw it."""
    primaries = np.zeros((25, 25), np.int64)
    primaries[12, 12] = 1000
    for neighbors in (4, 8):
        talk = Crosstalk(mean_fired_neighbors=0.2, diagonal=float(neighbors == 8))
        rng = generator(1, "crosstalk")
        totals = np.array([crosstalk.spread(rng, primaries, talk).sum() for _ in range(400)])
        term = f"crosstalk, {neighbors} neighbors"
        yield mean_row(term, "avalanches per primary", 1 / (1 - 0.2), totals / 1000)
        variance = 0.2 * (1 - 0.2 / neighbors) / (1 - 0.2) ** 3
        yield variance_row(term, "variance per primary", variance, totals / 1000**0.5)
    talk = Crosstalk(mean_fired_neighbors=0.8)
    effects = AvalancheEffects(crosstalk=talk)
    # a frame has four corners alike, and pixels inside so far apart that none fires another
    means, apart = np.full((6, 6), 5.0), np.full((26, 26), 5.0)
    rng, corners, inside = generator(2, "crosstalk"), np.ix_([0, -1], [0, -1]), slice(5, -5, 5)
    corner = np.array([simulate_counts(rng, means, 1.0, effects)[corners] for _ in range(5_000)])
    term = "crosstalk, corner, by event"
    yield mean_row(term, "counts", float(crosstalk.mean(means, talk)[0, 0]), corner)
    spread = np.array(
        [crosstalk.spread(rng, rng.poisson(apart), talk)[inside, inside] for _ in range(500)]
    )
    yield variance_row(
        "crosstalk", "variance inside", float(crosstalk.variance(apart, talk)[10, 10]), spread
    )


def check_gate_and_jitter() -> Iterator[Row]:
    """Counts in proportion to the open time; spread of time stamps; no event outside the gate."""
    gate = Gate(period_s=1e-3, width_s=0.3e-3, phase_s=0.9e-3)
    exposure_s = 10.5e-3
    effects = AvalancheEffects(gate=gate)
    counts = simulate_counts(generator(5), np.full((50_000, 1), 1e4), exposure_s, effects)
    duty = open_fraction(gate, exposure_s)
    yield exact_row("gate", "open part of the exposure", 3.2e-3 / 10.5e-3, duty, 1e-12)
    yield mean_row("gate", "counts", 1e4 * exposure_s * duty, counts)
    times, _ = simulate_events(generator(6), np.full((5000, 1), 1e4), exposure_s, effects)
    closed = np.mean((times - gate.phase_s) % 1e-3 > 0.3e-3 * (1 + 1e-9))
    yield exact_row("gate", "events while closed", 0, float(closed), 1e-9)
    shift = stamp(generator(7), times, Jitter(sigma_s=93e-12)) - times
    yield mean_row("jitter", "mean shift (ps)", 0, shift * 1e12)
    # times of 10 ms are known to 1.7e-18 s
    yield variance_row("jitter", "variance (ps²)", 93.0**2, shift * 1e12)


def check_counters() -> Iterator[Row]:
    """Digital and analog counters: wrap, linearity, flags."""
    events = np.arange(1000)[None, :]
    wrapped, flags = read_digital(events, DigitalCounter.of_bits(8, "wrap"))
    yield exact_row(
        "digital counter",
        "wraps to the low bits",
        0,
        float(np.abs(wrapped - events % 256).max()),
        1e-9,
    )
    yield exact_row("digital counter", "first flag", 256, float(np.argmax(flags)), 1e-9)
    for step_v, capacity in ((10e-3, 319), (30e-3, 106)):
        counter = changed(preset("spadcam").counter, step_v=step_v, step_sigma_v=0.02 * step_v)
        assert isinstance(counter, AnalogCounter)
        ramp = np.tile(np.arange(2 * capacity), (200, 1))
        pixels = analog_pixels(counter, ramp.shape, 0.1, 3)
        counts, flags = read_analog(generator(8), ramp, counter, pixels, 0.1)
        term = f"analog counter, {1e3 * step_v:g} mV"
        line = linregress(ramp[~flags], counts[~flags])
        yield exact_row(term, "slope of counts over events", 1, float(line.slope), 1e-3)
        yield exact_row(term, "1 − R² to saturation", 0, 1 - float(line.rvalue) ** 2, 1e-2)
        full = (ramp + 0.5) * pixels.step_v + pixels.leaked_v > counter.swing_v
        yield exact_row(term, "full counters not flagged", 0, float(np.mean(~flags & full)), 1e-9)


def check_frames() -> Iterator[Row]:
    """Photon transfer, binary frames, event streams, and independence of how frames are drawn."""
    ideal, spadcam = preset("ideal"), preset("spadcam")
    levels = np.geomspace(1, 3000, 30)
    rate = np.broadcast_to(levels[:, None, None] / ideal.exposure_s, (30, 100, 100))
    counts = expose_rate(rate, ideal, seed=1, sequence="transfer").counts.astype(np.float64)
    means, variances = counts.mean((1, 2)), counts.var((1, 2))
    slope = float(np.sum(variances / means) / 30)
    # variance over mean of 10⁴ pixels scatters by √(2 + 1/mean)/100
    error = float(np.sqrt((2 + 1 / levels).sum()) / 100 / 30)
    yield Row(
        "photon transfer", "variance over mean, no dead time", 1.0, slope, (slope - 1) / error
    )
    bits = unpack(expose_binary(np.full((40, 100, 100), 3.0), ideal, seed=2, sequence="bits"), 100)
    yield mean_row("binary frames", "part of ones", -np.expm1(-0.3), bits.astype(np.float64))
    busy = changed(
        without(spadcam, "counter"),
        afterpulsing=Afterpulsing(mean_carriers=0.2, delay_s=1e-3),
        dead_time=DeadTime(kind="paralyzable", dead_time_s=1e-3),
        crosstalk=Crosstalk(mean_fired_neighbors=0.1),
        dark_counts=ideal.dark_counts,
        bias=ideal.bias,
    )
    for name, sensor in (
        ("dead time alone", without(without(busy, "afterpulsing"), "crosstalk")),
        ("all effects", busy),
    ):
        rate = np.full((300, 12, 12), 100.0)
        frames = expose_rate(rate, sensor, seed=3, sequence="frames").counts.astype(np.int64)
        stream = histogram(expose_events(rate, sensor, seed=3, sequence="events"))
        z = law_z(frames[:, 1:-1, 1:-1].ravel(), stream[:, 1:-1, 1:-1].ravel())
        yield Row("event stream", f"law of its histogram, as z, {name}", 0.0, z, z)
    whole = expose_rate(rate, busy, seed=4, sequence="order", threads=2)
    alone = expose_rate(rate[17:18], busy, seed=4, sequence="order", first_frame=17, threads=1)
    same = whole.counts[17].tobytes() == alone.counts[0].tobytes()
    yield exact_row("randomness", "frame drawn alone equals frame among 300", 1, float(same), 1e-9)


def check_dim_light() -> Iterator[Row]:
    """Frames with fewer events than pixels, drawn as waits for the next one."""
    sensor = preset("ideal")
    rate = np.full((16, 500, 500), 0.05 / sensor.exposure_s)
    counts = expose_rate(rate, sensor, seed=5, sequence="dim").counts.astype(np.int64)
    yield mean_row("dim light", "counts", 0.05, counts)
    yield variance_row("dim light", "variance of counts", 0.05, counts)


def check_rare_bits() -> Iterator[Row]:
    """Binary frames of so little light that the last bits of a chance count.

    Of 16 random bits, half a chance in 65536 and one and a third; half of it dark counts.
    """
    ideal, side = preset("ideal"), 1000
    for mean in (8e-6, 2e-5):
        half_hz = mean / 2 / ideal.exposure_s
        sensor = changed(ideal, dark_counts=DarkCounts(bulk_mean_hz_um2=half_hz / 3600))
        rate = np.broadcast_to(half_hz, (100, side, side))
        packed = expose_binary(rate, sensor, seed=2, sequence="rare")
        ones, bits = int(np.bitwise_count(packed).sum(dtype=np.int64)), 100 * side**2
        chance = float(-np.expm1(-mean))
        z = (ones - bits * chance) / (bits * chance) ** 0.5
        yield Row("binary frames", f"part of ones, {mean:g} events", chance, ones / bits, z)


def check_poisson_means() -> Iterator[Row]:
    """Means around each for which the Poisson law is tabulated, up to 4, and beyond."""
    means = (np.arange(256) + 0.02) / 16
    counts = draw_poisson(generator(8, "means"), np.repeat(means, 200_000)).reshape(256, -1)
    yield from worst_of_each(
        (
            mean_row("Poisson", "counts (worst mean)", float(mean), some),
            variance_row("Poisson", "variance of counts (worst mean)", float(mean), some),
        )
        for mean, some in zip(means, counts, strict=True)
    )


def check_few_lost() -> Iterator[Row]:
    """Paralyzable, one arrival in six lost: closed forms of the module's two moments."""
    x, a, side = 2.0, 0.24, 2000
    dead = DeadTime(kind="paralyzable", dead_time_s=a * 1e-6)
    rates = np.full((side, side), 1e6)
    counts = draw_counts(generator(32), rates, x * 1e-6, AvalancheEffects(dead_time=dead))
    once, twice = (x - n * a - 1 + np.exp(n * a - x) for n in (1, 2))
    mean = 1 - np.exp(-x) + np.exp(-a) * once
    pairs = np.exp(-a) * once + np.exp(-2 * a) * ((x - 2 * a) ** 2 / 2 - twice)
    term = "paralyzable, few lost"
    yield mean_row(term, "counts", float(mean), counts)
    yield variance_row(term, "variance of counts", float(2 * pairs + mean - mean**2), counts)
