"""Limits |z| < 5.5 fail by chance in fewer than 4e-8 of comparisons, all of a file in 1e-5."""

from dataclasses import replace

import numpy as np
import pytest

from megalopta.sensor import FRAME_PRESETS, Sensor, changed, load_sensor
from megalopta.sensor.frame.exposure import expose_frames
from megalopta.sensor.frame.moments import electron_moments, reading_moments
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.shot import NextFrames, Shot

PLAIN = changed(
    FRAME_PRESETS["imx174"],
    efficiency={"wavelengths_nm": [300, 1100], "values": [1, 1]},
    **{"full_well_e": 5000, "read": {"median_e": 2}, "adc": {"e_per_dn": 1.5, "black_dn": 30}},
)
SHAPE = 8, 100, 100


def light(electrons, sensor, shape=SHAPE):
    return np.full(shape, electrons / sensor.exposure_s)


def drawn(electrons, sensor, shape=SHAPE):
    return expose_frames(light(electrons, sensor, shape), sensor, Draw(1, "test"))[0]


def electron_by_electron(rng, sensor, mean_e, number):
    """Readings by the chain as written down, with a loop over the stages of the register."""
    register, adc = sensor.em, sensor.adc
    dark = sensor.dark.mean_e_s * sensor.exposure_s + sensor.cic_e  # presets are at the reference
    electrons = np.minimum(rng.poisson(mean_e + dark, number), int(sensor.full_well_e))
    for _ in range(register.stages if register.gain > 1 else 0):
        electrons += rng.binomial(electrons, register.gain ** (1 / register.stages) - 1)
    volts = np.minimum(electrons, register.well_e) + rng.normal(0, sensor.read.median_e, number)
    dn = np.clip(np.round(volts / adc.e_per_dn + adc.black_dn), 0, 2**adc.bits - 1)
    return (dn - adc.black_dn) * adc.e_per_dn / register.gain


@pytest.mark.parametrize("name", FRAME_PRESETS)
@pytest.mark.parametrize("electrons", [0.001, 0.1, 10, 500, 10_000])
def test_presets_read_what_a_simulation_electron_by_electron_does(name, electrons):
    alike = {"dsnu_pixel_e": 0, "prnu_pixel": 0}
    sensor = changed(FRAME_PRESETS[name], pattern=alike, read={"log_sigma": 0})
    number = 40_000 if sensor.em.gain == 1 else 4000 if electrons < 100 else 1000
    simulated = electron_by_electron(np.random.default_rng(7), sensor, electrons, number)
    exposure = drawn(electrons, sensor, (4, 100, 100))
    most = min(sensor.full_well_e, 65_000 * sensor.adc.e_per_dn / sensor.em.gain)
    assert (exposure.saturated.mean() > 0.99) == (electrons > most)
    mean, variance = np.ravel(reading_moments(light(electrons, sensor, (1, 1, 1)), sensor))
    for sample in (exposure.counts.ravel().astype(float), simulated):
        squares, z = (sample - mean) ** 2, 5.5 / sample.size**0.5
        assert abs(sample.mean() - mean) < z * variance**0.5 + 1e-5 * mean  # single precision
        rounded = 1e-5 * variance + (1e-7 * mean) ** 2
        assert abs(squares.mean() - variance) < z * squares.std() + rounded


@pytest.mark.parametrize(("gain", "stages"), [(2, 50), (10, 100), (100, 536), (1000, 604)])
def test_excess_noise_of_a_register(gain, stages):
    register, quiet = {"gain": gain, "stages": stages}, {"bits": 24, "black_dn": 0}
    sensor = changed(PLAIN, em=register, read={"median_e": 0}, adc=quiet)
    squares = (drawn(20, sensor, (4, 100, 100)).counts.astype(float) - 20) ** 2
    excess = squares.mean() / 20 - (1.5 / gain) ** 2 / 12 / 20
    exact = 2 * (gain - 1) * gain ** (-(stages + 1) / stages) + 1 / gain
    assert abs(excess - exact) < 5 * squares.std() / squares.size**0.5 / 20


def test_empty_pixels_of_a_noiseless_camera_are_poisson_with_clock_induced_charge():
    sensor = changed(PLAIN, cic_e=0.2, read={"median_e": 0}, adc={"e_per_dn": 1.0})
    empty = (drawn(0.5, sensor).counts == 0).mean()
    exact = np.exp(-0.7)
    assert abs(empty - exact) < 5 * np.sqrt(exact * (1 - exact) / 80_000)


def test_dark_current_doubles_over_its_temperature():
    for celsius, factor in ((20, 1), (26, 2), (8, 0.25)):
        dark = {"mean_e_s": 300, "doubling_k": 6, "reference_celsius": 20, "celsius": celsius}
        mean, _ = electron_moments(light(0, PLAIN, (1, 2, 2)), changed(PLAIN, dark=dark))
        np.testing.assert_allclose(mean, 3 * factor)


def test_amplifiers_switch_with_a_lorentzian_spectrum():
    read = {"median_e": 0, "telegraph_share": 1, "telegraph_e": 20, "telegraph_s": 0.05}
    sensor = changed(PLAIN, read=read, adc={"e_per_dn": 0.1, "black_dn": 2000})
    levels = drawn(0, sensor, (400, 12, 12)).counts
    assert set(np.unique(levels.round())) == {-10, 10}
    for lag in (1, 5, 10):  # autocorrelation 100·exp(−t/τ), of which a Lorentzian is the transform
        products = levels[lag:] * levels[:-lag]
        error = products.mean(axis=0).std() / 12
        assert abs(products.mean() - 100 * np.exp(-lag * 0.01 / 0.05)) < 5 * error
    mean, variance = reading_moments(light(0, sensor, (1, 12, 12)), sensor)
    np.testing.assert_allclose([mean, variance], [0 * mean, 100 + 0 * mean], atol=1e-9)


def test_lag_is_that_of_split_electrons():
    sensor = changed(PLAIN, lag_share=0.2)
    # light before frame 5 and none from then on: 0.8·0.2ⁿ of what is left of all earlier frames
    rates = np.where(np.arange(8)[:, None, None] < 5, light(100, sensor, (8, 20, 20)), 0)
    mean, _ = electron_moments(rates, sensor)
    np.testing.assert_allclose(mean[:, 0, 0], [100] * 5 + [25 * 0.8 * 0.2**n for n in range(3)])


def test_a_rolling_shutter_sees_later_light_in_later_rows():
    sensor = changed(PLAIN, exposure_s=0.002, readout_s=0.008)
    frames = np.stack([np.full((9, 6, 1), value) for value in (1.0, 2.0)]) * 1e-4
    flow, hidden = np.zeros((1, 9, 6, 2)), np.zeros((1, 9, 6), bool)
    shot = Shot(
        **{"radiance": frames[:1], "bands_nm": [(500, 600)], "sensor": sensor, "sub_frames": 2},
        draw=Draw(0, "x", frame_period_s=0.01),
        following=NextFrames(radiance=frames[1:], flow=flow, hidden=hidden),
    )
    exposure, _ = shot.readings(None)
    # light grows from 1 to 2 over the period: rows see the middle of their exposure
    rows = exposure.expectation.photons[0, :, 0]
    middles = (0.001 + np.arange(9) / 8 * 0.008) / 0.01
    np.testing.assert_allclose(rows / rows[0], (1 + middles) / (1 + middles[0]), rtol=1e-6)
    with pytest.raises(ValueError, match="longer than a frame"):
        replace(shot, sensor=changed(sensor, readout_s=0.009))


def test_sensors_of_any_kind_come_from_files(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("preset: orca-quest-2\nread: {median_e: 0.3}\n")
    assert load_sensor(path) == changed(FRAME_PRESETS["orca-quest-2"], read={"median_e": 0.3})
    with pytest.raises(ValueError, match=r"kind: frame; this takes SPAD arrays only"):
        load_sensor(path, Sensor)
    path.write_text("preset: mine.yaml")
    with pytest.raises(ValueError, match="a file; give the name of a preset"):
        load_sensor(path)
