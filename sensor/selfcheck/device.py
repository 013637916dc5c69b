"""Pixels of a device against what was measured of them and against their laws, in operation."""

from collections.abc import Iterator

import numpy as np
from scipy.special import pdtr
from scipy.stats import norm, truncnorm

from megalopta.core.arrays import Floats
from megalopta.sensor import changed
from megalopta.sensor.effects import (
    Afterpulsing,
    AvalancheMaps,
    Crosstalk,
    DarkCounts,
    DeadTime,
    Temperature,
    bias,
    dark_count_factor,
    dark_count_rate,
    mean_density,
)
from megalopta.sensor.optics import Efficiency
from megalopta.sensor.selfcheck.comparison import Row, exact_row, mean_row, variance_row
from megalopta.sensor.spad import draw_fixed_pattern, preset

_UM2 = 1e-12


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
    hot = DarkCounts(hot_fraction=1.0, hot_mean_hz_um2=2.0, hot_sigma_hz_um2=4.0)
    width = np.log(1 + (4 / 2) ** 2) ** 0.5
    densities, of_hot = (dark_count_rate(each, (400, 400), _UM2, 1) for each in (ordinary, hot))
    for term, unit, values, law in (
        (", ordinary pixels", "Hz/µm²", densities, truncnorm(-0.5 / 0.4, np.inf, 0.5, 0.4)),
        (", hot pixels", "ln", np.log(of_hot), norm(np.log(2) - width**2 / 2, width)),
    ):
        yield mean_row("dark counts" + term, f"mean ({unit})", float(law.mean()), values)
        yield variance_row("dark counts" + term, f"variance ({unit}, squared)", law.var(), values)
    mixed = changed(ordinary, hot_fraction=0.1, hot_mean_hz_um2=20.0, hot_sigma_hz_um2=5.0)
    expected = 0.9 * float(truncnorm(-0.5 / 0.4, np.inf, 0.5, 0.4).mean()) + 0.1 * 20
    yield exact_row("dark counts", "mean as stated (Hz/µm²)", expected, mean_density(mixed), 1e-9)
    sigma = {"mismatch_sigma": 0.2}
    dead = DeadTime(kind="nonparalyzable", dead_time_s=1e-6)
    sensor = changed(
        preset("ideal"),
        dead_time=changed(dead, **sigma),
        afterpulsing=changed(cold.afterpulsing, **sigma),
        crosstalk=changed(cold.crosstalk, **sigma),
    )
    maps = draw_fixed_pattern(sensor, (200, 200)).avalanches
    assert maps is not None
    for field, factors in zip(maps._fields, maps, strict=True):
        yield mean_row(f"{field} mismatch", "mean factor", 1.0, factors)
        yield variance_row(f"{field} mismatch", "variance of factors", 0.04, factors)


def check_bias_laws() -> Iterator[Row]:
    """Even pixels at biases below the onset, at the reference, where it holds, and above."""
    onset, scale, efold, reference, slopes = 0.9, 0.2, 0.12, 1.2, (1.0, 2.5)
    even = changed(
        preset("ideal"),
        efficiency=Efficiency(wavelengths_nm=(400, 700), values=(0.5, 0.5)),
        bias={"onset_v": onset, "reference_v": reference, "efficiency_scale_v": scale},
        dark_counts=DarkCounts(bulk_mean_hz_um2=0.5),
        afterpulsing=Afterpulsing(mean_carriers=0.1),
        crosstalk=Crosstalk(mean_fired_neighbors=0.1),
    )
    steep = {"dark_efold_v": efold, "afterpulsing_slope": slopes[0], "crosstalk_slope": slopes[1]}
    full = -np.expm1(-(reference - onset) / scale)
    for excess in (0.7, 1.0, reference, 1.5):
        above = float(excess > onset)
        pattern = draw_fixed_pattern(changed(even, bias=steep | {"excess_v": excess}), (1, 1))
        rise = excess / reference - 1
        # no map where nothing differs from what the fields say
        maps = pattern.avalanches or AvalancheMaps.alike((1, 1))
        laws = (
            ("efficiency", -np.expm1(-above * (excess - onset) / scale) / full),
            ("dark counts (Hz)", 0.5 * 3600 * above * np.exp((excess - reference) / efold)),
            ("afterpulsing", max(1 + slopes[0] * rise, 0.0)),
            ("crosstalk", max(1 + slopes[1] * rise, 0.0)),
        )
        found = (
            pattern.efficiency_factor,
            pattern.dark_counts_hz,
            maps.afterpulsing,
            maps.crosstalk,
        )
        for (quantity, right), got in zip(laws, found, strict=True):
            term = f"bias, {excess:g} V"
            yield exact_row(term, quantity, float(right), got.item(), 1e-9 * (1 + float(right)))


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
