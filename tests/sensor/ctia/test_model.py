import numpy as np
import pytest

from megalopta.scenes.spectra.outdoors import MOONLESS_ZENITH
from megalopta.sensor import expose
from megalopta.sensor.ctia import model
from megalopta.sensor.ctia.bias import FixedBias
from megalopta.sensor.ctia.integration import Pixel
from megalopta.sensor.ctia.photodiode import ELEMENTARY_CHARGE_C, Photodiode, reverse_current
from megalopta.sensor.optics import PLANCK_TIMES_LIGHT_SPEED, Efficiency, Lens
from megalopta.sensor.sampling.streams import generator

BANDS = np.array([[900.0, 1300.0], [1300.0, 1700.0]])
SILENT = model.CtiaNoise(photon_shot=False, dark_shot=False, reset=False)
IDEAL = model.CtiaSensor(
    name="ideal",
    pitch_m=100e-6,
    exposure_s=0.1,
    lens=Lens(f_number=1.4),
    efficiency=Efficiency(wavelengths_nm=(800, 1800), values=(1.0, 1.0)),
    diode=Photodiode(),
    noise=SILENT,
)
QUIET = model.CTIA_PRESETS["ctia_ingaas_quiet"]


def night(frames=2, rows=6, columns=8):
    means = [MOONLESS_ZENITH(np.linspace(*band, 400)).mean() for band in BANDS]
    return np.broadcast_to(means, (frames, rows, columns, 2))


def test_every_photon_of_an_ideal_pixel_becomes_an_electron():
    radiance = 2e-8
    reading = expose(np.full((1, 1, 1, 1), radiance), [[1000, 1010]], IDEAL, seed=0, stream="")
    irradiance = np.pi * radiance * 10 / (4 * 1.4**2 + 1)
    photons = irradiance * 1e-8 * 1005e-9 / PLANCK_TIMES_LIGHT_SPEED * 0.1
    assert reading.counts[0, 0, 0] == pytest.approx(photons, rel=1e-7)


def test_fixed_patterns_have_the_spread_stated():
    free = QUIET.model_copy(update={"bias": FixedBias()})
    array, count = model.pixels(free, (400, 400)), 160_000
    decibel = 20 * np.log10(array.gain)
    for values, mean, sigma in (
        (decibel, 130.0, 3.4),
        (array.bias_v, 18.7e-3, 10e-3),
        (array.dark_scale, 1.0, 0.1),
    ):
        # |z| < 5, false alarm 6e-7; standard error of sigma below sigma/sqrt(count)
        assert abs(values.mean() - mean) < 5 * sigma / np.sqrt(count)
        assert abs(values.std() - sigma) < 5 * sigma / np.sqrt(count)


def test_a_longer_frame_period_ages_the_gate_faster():
    dark = np.zeros((3, 3, 3))
    fast, _ = model.volt_moments(dark, QUIET)
    slow, _ = model.volt_moments(dark, QUIET, frame_period_s=0.2)
    np.testing.assert_array_equal(slow[1], fast[2])


def test_saturated_readings_are_flagged_and_hold_the_swing():
    light = np.array([[[1e-12, 1e-9]]])
    reading = model.expose_photocurrent(light, IDEAL, seed=0, stream="")
    np.testing.assert_array_equal(reading.saturated, [[[False, True]]])
    assert reading.volts[0, 0, 1] == IDEAL.swing_v


def test_presets_meet_the_currents_they_were_made_from():
    assert reverse_current(model.PHOTODIODES["si"], 10.0) == pytest.approx(50e-12, rel=1e-3)
    assert reverse_current(model.PHOTODIODES["si"], 15e-3) == pytest.approx(1.6e-12, rel=1e-3)
    assert reverse_current(model.PHOTODIODES["ingaas"], 0.1) == pytest.approx(170e-9, rel=1e-3)


def test_impossible_requests_are_refused():
    for light in (np.zeros((2, 2)), np.full((1, 1, 1), -1e-12), np.full((1, 1, 1), np.nan)):
        with pytest.raises(ValueError, match="photocurrent_a"):
            model.expose_photocurrent(light, IDEAL, seed=0, stream="")
    with pytest.raises(ValueError, match="reaches outside"):
        expose(night(), [[300, 500], [500, 900]], QUIET, seed=0, stream="")


def test_readings_near_the_rail_scatter_as_stated_and_electrons_go_on():
    noisy = IDEAL.model_copy(update={"noise": SILENT.model_copy(update={"read_noise_v": 0.05})})
    full = IDEAL.swing_v * IDEAL.capacitance_f / IDEAL.exposure_s
    light = np.full((1, 200, 200), full) * np.linspace(0.96, 1.02, 200)
    volts = model.expose_photocurrent(light, noisy, seed=5, stream="").volts
    mean, variance = model.volt_moments(light, noisy)
    assert mean.max() <= IDEAL.swing_v
    # |z| < 5, false alarm 6e-7 each
    assert abs((volts - mean).sum()) < 5 * variance.sum() ** 0.5
    excess = (volts - mean) ** 2 - variance
    assert abs(excess.sum()) < 5 * excess.std() * excess.size**0.5
    electrons, _ = model.electron_moments(2 * light, noisy)
    expected = 2 * light * IDEAL.exposure_s / ELEMENTARY_CHARGE_C
    np.testing.assert_allclose(electrons, expected, rtol=1e-9)


def test_pixel_held_at_the_rail_has_no_shot_noise():
    diode, dark = Photodiode(saturation_current_a=2e-15, shunt_ohm=5e12), np.zeros(40_000)
    held = Pixel(diode, 1e-12, 3.3, 1e6, dark - 0.1)
    assert not model.draw_noise(
        generator(0, "x"), model.CtiaNoise(reset=False), held, dark, 0.05
    ).any()


def test_reset_noise_of_10_pf_is_20_microvolts():
    big = Pixel(Photodiode(temperature_k=300), 10e-12, 3.3, 1e6, 0.0)
    reset = SILENT.model_copy(update={"reset": True})
    variance = model.noise_variance(reset, big, np.zeros(1), 0.05)
    assert variance**0.5 == pytest.approx(20.35e-6, rel=1e-3)
