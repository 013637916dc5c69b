"""Data sheets against closed forms, drawn frames and the light of pictures."""

import json
import math

import numpy as np
import pytest
from PIL import Image

from megalopta import data_sheet
from megalopta.benchmark.data_sheet import REFLECTANCE
from megalopta.benchmark.data_sheet_page import at_levels, figures, write_data_sheet
from megalopta.cli import main as cli
from megalopta.core.errors import UserError
from megalopta.dataset.picture_light import photons_per_lux
from megalopta.scenes import Light, Pictures
from megalopta.sensor import changed, ctia_preset, expose_rate, preset
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
    curve, signal = sheet.curve, PDE * sheet.curve.photons
    far = signal + DARK < CAPACITY - 10 * math.sqrt(CAPACITY)
    np.testing.assert_allclose(curve.mean[far], (signal + DARK)[far], rtol=1e-9)
    np.testing.assert_allclose(curve.sigma[far], np.sqrt(signal + DARK)[far], rtol=1e-9)
    np.testing.assert_allclose(curve.snr[far], (signal / np.sqrt(signal + DARK))[far], rtol=1e-6)
    # x²/(x + DARK) = 1; between points of curves, ten per decade, that are not quite straight
    least = (1 + math.sqrt(1 + 4 * DARK)) / 2 / PDE
    assert sheet.threshold_photons == pytest.approx(least, rel=2e-3)
    full = (DARK + 0.9 * (CAPACITY - DARK) - DARK) / PDE
    assert sheet.saturation_photons == pytest.approx(full, rel=6e-3)
    assert sheet.pde == pytest.approx(PDE)
    np.testing.assert_allclose(sheet.dark_hz, DARK / 1e-3)


def test_readings_are_those_of_drawn_frames():
    """Means and deviations of 1000 frames, at dead time 1/10 of the time between photons."""
    device = changed(
        COUNTER,
        dark_counts={"bulk_sigma_hz_um2": 1.0},
        dead_time={"kind": "nonparalyzable", "dead_time_s": 2e-6},
    )
    sheet = data_sheet(device)
    place = int(np.argmin(np.abs(sheet.curve.photons - 200)))
    shape, photons = (16, 16), sheet.curve.photons[place]
    rate_hz = PDE * photons / 1e-3 * draw_fixed_pattern(device, shape).efficiency_factor
    light_hz = np.broadcast_to(rate_hz, (1000, *shape))
    counts = expose_rate(light_hz, device, seed=0, stream="sheet").counts
    mean, sigma = np.median(counts.mean(axis=0)), np.median(counts.std(axis=0))
    # standard errors of medians over 256 pixels, five of them
    assert sheet.curve.mean[place] == pytest.approx(mean, abs=5 * sigma / math.sqrt(1000 * 256 / 2))
    assert sheet.curve.sigma[place] == pytest.approx(sigma, rel=5 / math.sqrt(2 * 1000 * 256 / 2))


def test_light_levels_are_those_of_pictures(tmp_path):
    """Photons of daylight on the pixel, by the light of pictures of the same reflectance."""
    sheet, file = data_sheet(COUNTER), tmp_path / "gray.png"
    Image.new("L", (8, 8), 128).save(file)
    bands = [(float(low), float(low + 25)) for low in range(400, 1000, 25)]
    light, gray = Light(level="daylight"), np.full(3, REFLECTANCE)
    of_unit = Pictures(file=str(file), spectrum="light").radiance_of_unit(light, bands, gray)
    photons = photons_per_lux(of_unit, light, bands, COUNTER, gray) * 1e5
    assert sheet.levels["daylight"].photons.item() == pytest.approx(photons, rel=0.01)
    # of a flat efficiency, every photon is detected as often
    assert sheet.lux_per_photon == pytest.approx(1e5 / photons, rel=0.01)


def test_a_ctia_pixel_ends_at_its_swing():
    sensor = ctia_preset("ctia_ingaas_quiet")
    sheet = data_sheet(sensor)
    electrons = sensor.swing_v * sensor.capacitance_f / 1.602176634e-19
    assert sheet.curve.mean.max() == pytest.approx(electrons, rel=1e-6)
    assert sheet.saturation_photons * sheet.pde == pytest.approx(0.9 * electrons, rel=0.1)


def test_presets_have_a_sheet_of_text():
    for name in ("ideal", "ctia_si", "webster-130nm"):
        sheet = data_sheet(name)
        assert all(map(all, (*figures(sheet), *at_levels(sheet))))
    assert math.isnan(data_sheet("ideal").saturation_photons)


def test_a_device_file_says_where_values_are_from(tmp_path, capsys):
    np.save(tmp_path / "dark.npy", np.full((4, 12), 160.0))
    (tmp_path / "mine.yaml").write_text(
        "preset: webster-130nm\nname: mine\nexposure_s: 0.01\nmeasured: {dark_counts: dark.npy}\n"
    )
    page = tmp_path / "mine.html"
    cli.main(["sensor", str(tmp_path / "mine.yaml"), "--out", str(page)])
    text = capsys.readouterr().out
    lines = {
        line.split("  ")[0]: line.rstrip().split("  ")[-1].strip() for line in text.splitlines()
    }
    assert lines["exposure"] == "device file"
    assert lines["dark counts"] == "measured map"
    assert lines["dead time"] == "preset webster-130nm"
    assert "160 per second in every pixel" in page.read_text("utf-8")


def test_json_and_pictures(tmp_path, capsys):
    cli.main(["sensor", "ideal", "--json", "--wavelength-nm", "700"])
    told = json.loads(capsys.readouterr().out)
    assert (told["wavelength_nm"], told["saturation_photons"]) == (700, None)
    assert told["levels"]["starlight"]["snr"] == pytest.approx(
        [told["levels"]["starlight"]["photons"][0] ** 0.5]
    )
    picture = write_data_sheet(tmp_path / "sheet.png", data_sheet("webster-130nm"))
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("sensor", "wavelength_nm", "problem"),
    [
        ("nothing", None, "is unknown: use one of"),
        ("missing.yaml", None, "give the path of a device's YAML file"),
        ("spadcam", 1500.0, "outside the efficiency curve"),
        ("spadcam", 200.5, "detects nothing"),
    ],
)
def test_what_cannot_be_computed_is_refused(sensor, wavelength_nm, problem):
    if problem == "detects nothing":
        sensor = changed(COUNTER, efficiency={"wavelengths_nm": (200, 400), "values": (0, 0)})
    with pytest.raises(UserError, match=problem):
        data_sheet(sensor, wavelength_nm)
