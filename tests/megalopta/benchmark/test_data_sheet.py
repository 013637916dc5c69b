"""Data sheets against closed forms, drawn frames and the light of pictures."""

import json
import math
import re

import numpy as np
import pytest

from megalopta import data_sheet
from megalopta.benchmark.data_sheet import contrast_sheet
from megalopta.cli import main as cli
from megalopta.core.errors import UserError
from megalopta.dataset.picture_light import photons_per_lux
from megalopta.scenes import Light
from megalopta.scenes.stimuli.pictures import ColorsAsLight
from megalopta.sensor import CTIA_PRESETS, IMAGE_SENSORS, changed, expose_rate, preset
from megalopta.sensor.spad.device import draw_fixed_pattern

PDE, DARK, CAPACITY = 0.25, 9.0, 1023
IDEAL = preset("ideal")
COUNTER = changed(
    IDEAL,
    exposure_s=1e-3,
    efficiency={"wavelengths_nm": (400, 1000), "values": (PDE, PDE)},
    dark_counts={"bulk_mean_hz_um2": DARK * 1e-12 / IDEAL.active_area_m2 / 1e-3},
    counter={"kind": "digital", "capacity": CAPACITY},
)


def test_a_counter_of_poisson_events_has_its_closed_forms():
    sheet = data_sheet(COUNTER)
    curve = np.array([*json.loads(sheet.to_json())["curve"].values()])
    photons, *readings = curve[:, PDE * curve[0] + DARK < CAPACITY - 10 * math.sqrt(CAPACITY)]
    mean, sigma = PDE * photons + DARK, np.sqrt(PDE * photons + DARK)
    np.testing.assert_allclose(readings, [mean, sigma, PDE * photons / sigma], rtol=1e-6)
    # x²/(x + DARK) = 1; between points of curves, ten per decade, that are not quite straight
    least = (1 + math.sqrt(1 + 4 * DARK)) / 2 / PDE
    assert sheet.threshold_photons == pytest.approx(least, rel=2e-3)
    assert sheet.saturation_photons == pytest.approx(0.9 * (CAPACITY - DARK) / PDE, rel=6e-3)
    assert sheet.pde == pytest.approx(PDE)
    np.testing.assert_allclose(sheet.dark_hz, DARK / 1e-3)
    # daylight of pictures of the same reflectance
    light, gray = Light(level="daylight"), np.full(3, 0.18)
    bands = [(400.0, 700.0), (700.0, 1000.0)]
    of_unit = ColorsAsLight(spectrum="light").radiance_of_unit(light, bands, gray)
    per_lux = photons_per_lux(of_unit, light, bands, COUNTER, gray)
    assert sheet.lux_per_photon == pytest.approx(1 / per_lux, rel=0.03)


def test_readings_are_those_of_drawn_frames():
    """Means and deviations of 1000 frames, at dead time 1/10 of the time between photons."""
    dead_time = {"kind": "nonparalyzable", "dead_time_s": 2e-6}
    device = changed(COUNTER, dark_counts={"bulk_sigma_hz_um2": 1.0}, dead_time=dead_time)
    curve = data_sheet(device).curve
    at = curve.iloc[(curve["photons"] - 200).abs().argmin()]
    factor = draw_fixed_pattern(device, (16, 16)).efficiency_factor
    light_hz = np.broadcast_to(PDE * at["photons"] / 1e-3 * factor, (1000, 16, 16))
    counts = expose_rate(light_hz, device, seed=0, stream="sheet").counts
    mean, sigma = np.median(counts.mean(axis=0)), np.median(counts.std(axis=0))
    # standard errors of medians over 256 pixels, five of them
    assert at["mean"] == pytest.approx(mean, abs=5 * sigma / math.sqrt(1000 * 256 / 2))
    assert at["sigma"] == pytest.approx(sigma, rel=5 / math.sqrt(2 * 1000 * 256 / 2))


def test_a_ctia_pixel_ends_at_its_swing():
    sensor = CTIA_PRESETS["ctia_ingaas_quiet"]
    sheet = data_sheet(sensor)
    electrons = sensor.swing_v * sensor.capacitance_f / 1.602176634e-19
    assert sheet.curve["mean"].max() == pytest.approx(electrons, rel=1e-6)
    assert sheet.saturation_photons * sheet.pde == pytest.approx(0.9 * electrons, rel=0.1)


def test_a_device_file_says_where_values_are_from(tmp_path, capsys):
    np.save(tmp_path / "dark.npy", np.full((4, 12), 160.0))
    (tmp_path / "mine.yaml").write_text(
        "preset: webster-130nm\nname: mine\nexposure_s: 0.01\nmeasured: {dark_counts: dark.npy}\n"
    )
    page = tmp_path / "mine.html"
    cli.main(["sensor", str(tmp_path / "mine.yaml"), "--out", str(page)])
    told = capsys.readouterr().out
    assert re.search("exposure .* device file", told)
    assert re.search("dark counts .* measured map", told)
    assert re.search("dead time .* preset webster-130nm", told)
    assert "160 per second" in page.read_text("utf-8")
    np.save(tmp_path / "efficiency.npy", np.full((4, 12), 0.2))
    device = "preset: ideal\nmeasured: {efficiency: efficiency.npy}\nname: flat\n"
    (tmp_path / "flat.yaml").write_text(device)
    cli.main(["sensor", str(tmp_path / "flat.yaml"), "--out", str(page)])
    chart = page.read_text("utf-8").partition("Detection efficiency over wavelength")[2]
    chart = chart.partition("</svg>")[0]
    ticks = [float(tick) for tick in re.findall(r">([\d.]+)\s*<", chart)]
    assert 15 < max(tick for tick in ticks if tick < 200) < 22
    (tmp_path / "array.yaml").write_text("preset: spcimager\nname: array\nexposure_s: 0.01\n")
    cli.main(["sensor", str(tmp_path / "array.yaml")])
    told = capsys.readouterr().out
    words = "factor .* published", "cy .* partly assumed", "talk .* not stated", "swing_v +1 V"
    assert all(re.search(word, told) for word in words) and "\nexposure_s " not in told


def test_the_sheet_of_a_frame_camera_has_its_figures_of_emva_1288(capsys):
    cli.main(["sensor", "imx174"])
    assert re.search("F² +excess noise factor; photon tr.* K·F² +1.00", capsys.readouterr().out)


def test_what_cannot_be_computed_is_refused():
    for sensor, wavelength_nm, problem in (
        ("nothing", None, "is unknown; use one of"),
        ("missing.yaml", None, "give the path of a device's YAML file"),
        ("spadcam", 1500.0, "outside the efficiency curve"),
        ("davis346", 550.0, "have no wavelength"),
        (changed(COUNTER, efficiency={"values": (0, 0)}), 500.0, "detects nothing"),
    ):
        with pytest.raises(UserError, match=problem):
            data_sheet(sensor, wavelength_nm)


def test_noise_events_of_contrast_grow_with_bandwidth_and_end_in_bright_light():
    events_hz = contrast_sheet(IMAGE_SENSORS["davis346"]).curve["events/s"].to_numpy()
    assert 20 < events_hz.max() < 120
    assert events_hz[-1] == pytest.approx(0.01, abs=0.015)  # leak
