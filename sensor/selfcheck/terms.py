"""The effects one by one against closed forms: light, device, crosstalk, counters, frames."""

from collections.abc import Iterator

import numpy as np
from scipy.integrate import quad
from scipy.special import pdtr
from scipy.stats import linregress, lognorm, truncnorm

from megalopta.sensor import changed
from megalopta.sensor.avalanches import AvalancheEffects, simulate_counts, simulate_events
from megalopta.sensor.counters import (
    AnalogCounter,
    DigitalCounter,
    analog_pixels,
    read_analog,
    read_digital,
)
from megalopta.sensor.effects import (
    Afterpulsing,
    Crosstalk,
    DarkCounts,
    DeadTime,
    Gate,
    Jitter,
    Temperature,
    afterpulsing,
    bias,
    crosstalk,
    dark_count_factor,
    dark_count_rate,
    open_fraction,
    stamp,
)
from megalopta.sensor.optics import band_efficiency, photon_flux
from megalopta.sensor.readout import expose_binary, expose_events, histogram, unpack
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.comparison import (
    Check,
    Floats,
    Row,
    exact_row,
    law_z,
    mean_row,
    variance_row,
)
from megalopta.sensor.spad import draw_fixed_pattern, expose_rate, preset, without

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


def check_device() -> Iterator[Row]:
    """Patterns of many SPADCAM devices, and what moves them."""
    sensor = preset("spadcam")
    devices = [
        draw_fixed_pattern(changed(sensor, device_seed=seed), (16, 16)) for seed in range(400)
    ]
    density = np.concatenate([each.dark_counts_hz.ravel() for each in devices]) / 360
    yield exact_row("dark counts", "mean over devices (Hz/µm²)", 1.77, density.mean(), 0.04)
    yield exact_row("dark counts", "median (Hz/µm²)", 0.93, float(np.median(density)), 0.02)
    yield exact_row("dark counts", "σ (Hz/µm²)", 1.77, density.std(), 0.04)
    quiet = 16 * float(np.mean(density < 1.5))
    yield exact_row("dark counts", "pixels of 16 below 1.5 Hz/µm²", 11, quiet, 0.3)
    offsets = [bias.breakdown_offset(sensor.bias, (16, 16), seed).ravel() for seed in range(400)]
    yield variance_row("breakdown", "variance (V²)", 0.042**2, np.concatenate(offsets))
    yield from _check_bias()
    cooled = Temperature(celsius=-10, dcr_doubling_k=9)
    yield exact_row(
        "temperature",
        "decades for 30 K of cooling",
        -30 / 9 * np.log10(2),
        float(np.log10(dark_count_factor(cooled))),
        1e-9,
    )


def check_operation() -> Iterator[Row]:
    """Warm chip: what breakdown takes from the excess bias; drawn mismatch of avalanche effects."""
    cold = changed(
        preset("spadcam"),
        bias={"afterpulsing_slope": 1.0, "crosstalk_slope": 2.0, "onset_v": 0.0},
        afterpulsing=Afterpulsing(mean_carriers=0.1),
        crosstalk=Crosstalk(mean_fired_neighbors=0.1),
        temperature={"breakdown_v_per_k": 0.01},
    )
    shape, shift = (16, 16), 0.01 * 12
    warm = draw_fixed_pattern(changed(cold, temperature={"celsius": 32.0}), shape)
    before = draw_fixed_pattern(cold, shape)
    assert warm.avalanches is not None
    excess = 1.18 - bias.breakdown_offset(cold.bias, shape, cold.device_seed)
    for name, expected, measured in (
        (
            "dark counts",
            2 ** (12 / 9) * np.exp(-shift / 0.12) + 0 * excess,
            warm.dark_counts_hz / before.dark_counts_hz,
        ),
        (
            "efficiency",
            (1 - np.exp(-(excess - shift) / 0.2)) / (1 - np.exp(-excess / 0.2)),
            warm.efficiency_factor / before.efficiency_factor,
        ),
        ("afterpulsing, as the charge", (excess - shift) / 1.18, warm.avalanches.afterpulsing),
        ("crosstalk, twice the charge", 2 * (excess - shift) / 1.18 - 1, warm.avalanches.crosstalk),
    ):
        off = float(np.abs(measured / expected - 1).max())
        yield exact_row("breakdown, 12 K above", f"{name}, largest error", 0.0, off, 1e-9)
    # SciPy's laws, for pixels of 1 µm²
    ordinary = DarkCounts(bulk_mean_hz_um2=0.5, bulk_sigma_hz_um2=0.4)
    hot = DarkCounts(hot_fraction=1.0, hot_mean_hz_um2=2.0, hot_sigma_hz_um2=1.0)
    width = np.log1p(0.25) ** 0.5
    for term, model, law in (
        ("dark counts, ordinary pixels", ordinary, truncnorm(-0.5 / 0.4, np.inf, 0.5, 0.4)),
        ("dark counts, hot pixels", hot, lognorm(width, scale=2 * np.exp(-(width**2) / 2))),
    ):
        densities = dark_count_rate(model, (400, 400), _UM2, 1)
        yield mean_row(term, "mean (Hz/µm²)", float(law.mean()), densities)
        yield variance_row(term, "variance (Hz²/µm⁴)", float(law.var()), densities)
    sigma = {"mismatch_sigma": 0.2}
    dead = DeadTime(kind="nonparalyzable", dead_time_s=1e-6)
    sensor = changed(preset("ideal"), dead_time=changed(dead, **sigma))
    sensor = changed(sensor, afterpulsing=changed(cold.afterpulsing, **sigma))
    sensor = changed(sensor, crosstalk=changed(cold.crosstalk, **sigma))
    maps = draw_fixed_pattern(sensor, (200, 200)).avalanches
    assert maps is not None
    for field, factors in zip(maps._fields, maps, strict=True):
        yield mean_row(f"{field} mismatch", "mean factor", 1.0, factors)
        yield variance_row(f"{field} mismatch", "variance of factors", 0.04, factors)


def _check_bias() -> Iterator[Row]:
    model = preset("spadcam").bias
    volts = np.linspace(model.onset_v + 5e-4, 1.4, 8000)
    at = [changed(model, excess_v=float(excess)) for excess in volts]
    light = np.array([bias.efficiency_factor(each, 0.0) for each in at])
    dark = np.array([bias.dark_count_factor(each, 0.0) for each in at])
    best = float(volts[np.argmax(light / dark)])
    yield exact_row("bias", "bias of best SNR (V)", bias.best_excess_bias(model), best, 2e-4)
    # as measured, through a counter that fills up with dark counts: the mean of Poisson counts cut
    capacity, exposure_s = 320, 0.1
    dark_counts = 637 * dark * exposure_s
    bright = dark_counts + 1e5 * max(preset("spadcam").efficiency.values) * light * exposure_s
    seen = _mean_of_cut_poisson(bright, capacity) - _mean_of_cut_poisson(dark_counts, capacity)
    margin = volts[np.argmax(seen)] - bias.best_excess_bias(model)
    yield Row(
        "bias",
        "efficiency peak as measured lies above (V)",
        0.0,
        float(margin),
        0.0 if margin > 0.005 else np.inf,
    )


def _mean_of_cut_poisson(mean: Floats, capacity: int) -> Floats:
    return np.asarray(mean * pdtr(capacity - 2, mean) + capacity * (1 - pdtr(capacity - 1, mean)))


def check_afterpulsing() -> Iterator[Row]:
    """Multiplication of counts, and its loss to dead time."""
    exposures, p, delay_s = 40_000, 0.3, 1e-6
    traps = Afterpulsing(mean_carriers=p, delay_s=delay_s)
    running = DeadTime(start="stationary")
    rate_hz, exposure_s = 2e6, 5e-6
    rates = np.full((exposures, 1), rate_hz)
    effects = AvalancheEffects(running, traps, Gate(), Crosstalk())
    counts = simulate_counts(generator(1), rates, exposure_s, effects)
    yield mean_row("afterpulsing", "counts, 1/(1−p) per primary", 10 / (1 - p), counts)
    _, variance = afterpulsing.moments(rate_hz, exposure_s, traps, True)
    yield variance_row("afterpulsing", "variance of counts", float(variance), counts)
    table = Afterpulsing(
        mean_carriers=p, table_delays_s=(0, 1e-6, 4e-6), table_cumulative=(0, 0.5, 1)
    )
    counts = simulate_counts(generator(2), rates, exposure_s, effects._replace(afterpulsing=table))
    yield mean_row("afterpulsing", "counts, tabulated delay", 10 / (1 - p), counts)
    # primaries so rare that each cascade runs alone: a carrier survives with e^(−τ/delay)
    dead = DeadTime(kind="nonparalyzable", dead_time_s=delay_s)
    lone = AvalancheEffects(dead, traps, Gate(), Crosstalk())
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
    talk = Crosstalk(mean_fired_neighbors=0.2)
    effects = AvalancheEffects(DeadTime(), Afterpulsing(), Gate(), talk)
    means = np.full((6, 6), 5.0)
    rng = generator(2, "crosstalk")
    corner = np.array([simulate_counts(rng, means, 1.0, effects)[0, 0] for _ in range(20_000)])
    term = "crosstalk, corner, by event"
    yield mean_row(term, "counts", float(crosstalk.mean(means, talk)[0, 0]), corner)
    spread = np.array([crosstalk.spread(rng, rng.poisson(means), talk)[2, 3] for _ in range(8_000)])
    yield variance_row(
        "crosstalk", "variance inside", float(crosstalk.variance(means, talk)[2, 3]), spread
    )


def check_gate_and_jitter() -> Iterator[Row]:
    """Counts in proportion to the open time; spread of time stamps; no event outside the gate."""
    gate = Gate(period_s=1e-3, width_s=0.3e-3, phase_s=0.9e-3)
    exposure_s = 10.5e-3
    effects = AvalancheEffects(DeadTime(), Afterpulsing(), gate, Crosstalk())
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


TERM_CHECKS: tuple[Check, ...] = (
    check_light,
    check_device,
    check_operation,
    check_afterpulsing,
    check_crosstalk,
    check_gate_and_jitter,
    check_counters,
    check_frames,
)
