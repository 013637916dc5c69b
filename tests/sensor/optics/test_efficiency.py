"""Means of efficiency curves over bands, and curves from CSV files."""

import numpy as np
import pytest
from scipy.integrate import quad

from megalopta.sensor import (
    Efficiency,
    load_sensor,
    preset,
)
from megalopta.sensor.optics.efficiency import band_efficiency

CURVE = Efficiency(wavelengths_nm=(380, 450, 470, 620, 900), values=(0.02, 0.3, 0.21, 0.5, 0.0))


@pytest.mark.parametrize(
    "band", [(380.0, 900.0), (400.0, 440.0), (449.0, 451.0), (469.999, 620.001), (600.0, 601.0)]
)
def test_band_mean_equals_numerical_integral(band):
    nodes = [*band, *(w for w in CURVE.wavelengths_nm if band[0] < w < band[1])]
    pieces = zip(sorted(nodes)[:-1], sorted(nodes)[1:], strict=True)
    detected = sum(
        quad(lambda nm: np.interp(nm, CURVE.wavelengths_nm, CURVE.values) * nm, *piece)[0]
        for piece in pieces
    )
    photons = quad(lambda nm: nm, *band)[0]
    assert band_efficiency(CURVE, [band])[0] == pytest.approx(detected / photons, rel=1e-12)


@pytest.mark.parametrize("band", [(379.0, 500.0), (500.0, 900.5), (1000.0, 1100.0)])
def test_band_outside_the_curve_is_refused_with_both_ranges(band):
    with pytest.raises(ValueError, match=rf"{band[0]:g}–{band[1]:g} nm.*380–900 nm"):
        band_efficiency(CURVE, [band])


POINTS = Efficiency(wavelengths_nm=(400, 450.5, 700), values=(0.01, 0.2, 0.005))


def device(folder, text):
    (folder / "pde.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "device.yaml").write_text("{preset: spadcam, efficiency: {path: pde.csv}}")
    return folder / "device.yaml"


@pytest.mark.parametrize(
    "text",
    [
        "400,0.01\n450.5,0.2\n700,0.005",
        "wavelength_nm,efficiency\n400,0.01\n450.5,0.2\n700,0.005\n",
        "# bench, May\r\nnm,PDE\r\n 400 , 1e-2\r\n\r\n450.5,.2\r\n# end\r\n700,0.005\r\n",
        "\ufeff400,0.01\n450.5,0.2\n700,0.005",
    ],
)
def test_curve_is_read_with_or_without_names_and_comments(tmp_path, text):
    assert load_sensor(device(tmp_path, text)).efficiency == POINTS


def test_record_holds_the_numbers_and_needs_no_file(tmp_path):
    path = device(tmp_path, "400,0.01\n450.5,0.2\n700,0.005")
    sensor = load_sensor(path)
    (tmp_path / "pde.csv").unlink()
    assert type(sensor).model_validate(sensor.model_dump(mode="json")) == sensor
    assert sensor.lens == preset("spadcam").lens


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("400,1\n500,20", "line 2: efficiency 20 is not from 0 to 1; divide percents by 100"),
        ("400,0.1\n500,nan", "nan is not from 0 to 1"),
        ("400,0.1\n400,0.1", "line 2: .*400 nm follows 400; sort"),
        ("inf,0.1\n400,0.1", "sort"),
        ("0,0.1\n400,0.1", "positive wavelengths"),
        ("400;0.1\n500;0.2", "line 1 is not wavelength_nm,efficiency"),
        ("400,0.1\n500,20 %", "line 2 is not"),
        ("400,0.1", "has 1 points; give 2 or more"),
        (b"\xff\xfe4\x000\x00", "is not UTF-8 text"),
        ('400,"0.1\n500,0.2', "is not wavelength_nm"),
    ],
)
def test_impossible_curve_is_refused_in_one_sentence_with_its_line(tmp_path, text, message):
    with pytest.raises(ValueError, match=message) as refusal:
        load_sensor(device(tmp_path, text))
    assert "efficiency: " in str(refusal.value)
    assert "pde.csv" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_file_and_numbers_at_once_are_refused(tmp_path):
    path = device(tmp_path, "400,0.01\n500,0.2")
    path.write_text("{preset: spadcam, efficiency: {path: pde.csv, values: [0, 1]}}")
    with pytest.raises(ValueError, match="path and values given; give a file or numbers, not both"):
        load_sensor(path)
