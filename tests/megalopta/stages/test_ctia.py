"""A CTIA array as the image sensor of a rendered scene under airglow, through all stages."""

import math

import numpy as np
import pytest
import zarr
from scipy.ndimage import binary_erosion

from megalopta.config.light_scale import light_scale
from megalopta.config.model import built_in_names, load, parse
from megalopta.core.errors import UserError
from megalopta.dataset.frames import read_radiance_frames, read_truth_frames
from megalopta.report.page import write_report
from megalopta.scenes.spectra.night_sky import MOONLESS_ZENITH
from megalopta.sensor import (
    CtiaSensor,
    DacBias,
    FloatingGateBias,
    expectation,
    expose_ctia,
    read_counts,
    reading_electrons,
)
from megalopta.stages.pipeline import run_all
from megalopta.stages.sense import STAGE, open_exposure

pytestmark = pytest.mark.slow

SMALL = {
    "name": "night",
    "camera.width": "24",
    "camera.height": "20",
    "trajectory.frames": "12",
    "scene.trees": "6",
    "scene.density_per_ha": "60",
    "scene.undergrowth": "0",
    "scene.detail": "0.1",
    "render.samples_per_pixel": "1",
    "methods": "[NDS, BM]",
    "benchmark.sizes": "[20]",
    "benchmark.fluxes_per_decade": "1",
    "benchmark.repeats": "2",
}
HC_J_M = 1.98644586e-25


@pytest.fixture(scope="module")
def night(tmp_path_factory):
    return run_all(tmp_path_factory.mktemp("night") / "data", load("airglow", SMALL))


def test_the_shipped_example_is_built_in_and_renders_the_short_wave_infrared():
    assert "airglow" in built_in_names()
    settings = load("airglow")
    assert settings.light.level == "airglow"
    assert (settings.render.bands_nm[0][0], settings.render.bands_nm[-1][1]) == (900, 1700)
    assert all(isinstance(sensor, CtiaSensor) for sensor in settings.sensors)


def test_radiance_of_the_open_sky_is_that_of_airglow(night):
    bands = night.configuration.render.bands_nm
    radiance = np.concatenate([frames for _, frames in read_radiance_frames(night, 16)])
    nothing = np.array([truth.object_id == 0 for truth in read_truth_frames(night)])
    # away from branches, which a pixel's single path may hit although its center does not
    open_sky = binary_erosion(nothing, np.ones((1, 3, 3)))
    assert open_sky.sum() > 100
    expected = [MOONLESS_ZENITH(np.linspace(*band, 20001)).mean() for band in bands]
    seen = radiance[open_sky].astype(np.float64)
    error = seen.std(axis=0) / np.sqrt(len(seen))
    assert (np.abs(seen.mean(axis=0) - expected) < 5 * error).all()  # false alarm 2e-6 of 4 bands
    assert (error < 0.1 * np.array(expected)).all()


def test_store_holds_electrons_that_say_so(night):
    settings = night.configuration
    group = zarr.open_group(night.counts(settings.sensors[0], "airglow"), mode="r")
    assert group["counts"].attrs["unit"] == "electrons per exposure"
    assert group["mean_reading"].attrs["unit"] == "mean electrons per exposure"
    assert group["counts"].dtype == np.float32
    assert group.attrs["sensor"]["kind"] == "ctia"
    assert open_exposure(night, settings.sensors[0], "airglow").sensor == settings.sensors[0]


def test_electrons_without_noise_are_the_photons_times_efficiency_and_the_dark_current(night):
    """By hand: lens, pixel, photon energy and efficiency, and the dark current on top."""
    sensor, bands = night.configuration.sensors[0], night.configuration.render.bands_nm
    radiance = np.concatenate([frames for _, frames in read_radiance_frames(night, 16)])
    nm = np.array([np.linspace(*band, 2001) for band in bands])
    per_joule = (sensor.efficiency(nm) * nm).mean(axis=1) * 1e-9 / HC_J_M
    irradiance = math.pi * radiance * np.diff(bands)[:, 0] / (4 * sensor.lens.f_number**2 + 1)
    power = irradiance * sensor.lens.transmission * sensor.pitch_m**2
    signal = (power * per_joule).sum(axis=-1) * sensor.exposure_s
    dark = expectation(0 * radiance, bands, sensor, frame_period_s=0.1).mean_reading
    stated = open_exposure(night, sensor, "airglow").expectation()
    added = stated.mean_reading - dark
    # the mean over 2001 points counts the ends of a band in full; stores hold float32
    stored = 1e-7 * stated.mean_reading.max()
    np.testing.assert_allclose(added, signal, rtol=1e-3, atol=stored)


def test_readings_do_not_depend_on_how_frames_are_cut(night):
    settings, sensor = night.configuration, night.configuration.sensors[0]
    stored = read_counts(night.counts(sensor, "airglow"))
    frames = [frame for _, chunk in read_radiance_frames(night, 5) for frame in chunk]
    alone = expose_ctia(
        frames[11][np.newaxis],
        settings.render.bands_nm,
        sensor,
        seed=settings.seed,
        sequence=stored.sequence,
        first_frame=11,
        frame_period_s=1 / settings.trajectory.frame_rate_hz,
    )
    electrons = reading_electrons(alone.volts, sensor).astype(np.float32)
    np.testing.assert_array_equal(stored.exposure.counts[11], electrons[0])


def test_levels_change_the_spectrum_between_moon_and_airglow():
    settings = load("airglow", {"light.level": "full_moon"})
    bands = settings.render.bands_nm
    moon = settings.light.resolved().spectrum()
    grids = [np.linspace(*band, 20001) for band in bands]
    rendered = np.array([moon(grid).mean() for grid in grids])
    relit = rendered * light_scale(settings, "airglow")
    expected = [math.pi * MOONLESS_ZENITH(grid).mean() for grid in grids]
    np.testing.assert_allclose(relit, expected, rtol=1e-3)  # of three digits in lux


def test_report_speaks_of_electrons(night):
    text = write_report(night).read_text("utf-8")
    assert "From light to electrons" in text
    assert "Dark electrons" in text and "Expected electrons" in text
    assert "bias of the diodes floating gate" in text
    assert "no eye sees it" in text


def test_a_preset_with_another_kind_of_bias_loses_the_fields_of_the_old_one():
    gate = parse("sensors: [{preset: ctia_si, bias: {pulse_s: 1.0e-4}}]\n" + SWIR, "x")
    assert gate.sensors[0].bias == FloatingGateBias(pulse_s=1e-4)
    dac = parse("sensors: [{preset: ctia_si, bias: {kind: dac, bits: 10}}]\n" + SWIR, "x")
    assert dac.sensors[0].bias == DacBias(bits=10)


def test_a_band_outside_the_diodes_curve_is_refused_by_name():
    with pytest.raises(ValueError, match=r"400–475 nm reaches outside the efficiency curve"):
        STAGE.check(parse("sensors: [ctia_ingaas]", "x"))


def test_misspelt_fields_and_kinds_are_named():
    with pytest.raises(UserError, match=r"sensors\.0\.swing: unknown key; did you mean 'swing_v'"):
        parse("sensors: [{preset: ctia_si, swing: 2}]\n" + SWIR, "x")
    with pytest.raises(UserError, match=r"kind 'ccd' is unknown; use 'spad', 'ctia'"):
        parse("sensors: [{kind: ccd, name: x}]", "x")
    with pytest.raises(UserError, match="preset 'ctia' is unknown: use one of .*ctia_ingaas"):
        parse("sensors: [ctia]", "x")


SWIR = "render: {bands_nm: [[900, 1100]]}"
