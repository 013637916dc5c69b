"""Means of efficiency curves over bands, and curves from CSV files."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import RegularGridInterpolator

from megalopta.sensor import (
    Bias,
    Efficiency,
    EfficiencySurface,
    changed,
    detection_rate,
    load_sensor,
    preset,
    without,
)
from megalopta.sensor.effects.bias import breakdown_offset
from megalopta.sensor.optics.efficiency import band_efficiency
from megalopta.sensor.spad.device import draw_fixed_pattern

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


@pytest.mark.parametrize(
    ("wavelengths", "values", "message"),
    [
        ((400, 500), (0.1, 1.2), "less than or equal to 1"),
        ((400, 500), (0.1, -0.1), "greater than or equal to 0"),
        ((400, 500), (0.1, np.nan), "finite"),
        ((500, 400), (0.1, 0.2), "sort the curve"),
        ((400, 400), (0.1, 0.2), "sort the curve"),
        ((400, 500), (0.1,), "one value per wavelength"),
        ((400,), (0.1,), "at least 2"),
    ],
)
def test_impossible_curve_is_refused(wavelengths, values, message):
    with pytest.raises(ValueError, match=message):
        Efficiency(wavelengths_nm=wavelengths, values=values)


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


SURFACE = {
    "wavelengths_nm": (400.0, 500.0, 700.0),
    "excess_v": (1.0, 2.0, 4.0),
    "values": ((0.0, 0.1, 0.05), (0.1, 0.3, 0.1), (0.2, 0.4, 0.3)),
}
LINES = "wavelength_nm,excess_v,pdp\n" + "".join(
    f"{nm},{volts},{row[at]}\n"
    for at, nm in reversed(list(enumerate(SURFACE["wavelengths_nm"])))
    for volts, row in zip(SURFACE["excess_v"], SURFACE["values"], strict=True)
)


def surface_device(folder, text=LINES, bias="excess_v: 3.5, breakdown_sigma_v: 0.1"):
    (folder / "pdp.csv").write_text(text)
    (folder / "device.yaml").write_text(
        f"{{preset: ideal, bias: {{reference_v: 1.5, {bias}, "
        "efficiency_surface: {path: pdp.csv}}}"
    )
    return folder / "device.yaml"


def test_a_surface_is_read_from_lines_in_any_order(tmp_path):
    sensor = load_sensor(surface_device(tmp_path))
    assert sensor.bias.efficiency_surface == EfficiencySurface(**SURFACE)
    # halfway between the first two biases
    np.testing.assert_allclose(sensor.efficiency.values, (0.05, 0.2, 0.075))
    assert type(sensor).model_validate(sensor.model_dump(mode="json")) == sensor


@pytest.mark.parametrize("band", [(400.0, 480.0), (480.0, 650.0)])
@pytest.mark.parametrize("onset", ["", ", onset_v: 1.4"])
def test_every_pixel_detects_as_the_surface_says_at_its_own_bias(tmp_path, band, onset):
    bias = f"excess_v: 1.6, breakdown_sigma_v: 0.1{onset}"
    sensor = load_sensor(surface_device(tmp_path, bias=bias))
    volts = 1.6 - breakdown_offset(sensor.bias, (6, 7), sensor.device_seed)
    found = detection_rate(np.ones((1, 6, 7, 1)), [band], sensor)[0]
    ideal = changed(sensor, bias=Bias(), efficiency=Efficiency.off())
    photons = detection_rate(np.ones((1, 6, 7, 1)), [band], ideal)[0]
    grid = RegularGridInterpolator(
        (SURFACE["excess_v"], SURFACE["wavelengths_nm"]), np.array(SURFACE["values"])
    )

    def pdp(bias_v):
        integral = quad(
            lambda nm: float(grid((bias_v, nm))) * nm,
            *band,
            points=[500.0] if band[1] > 500 else None,
        )
        return integral[0] / ((band[1] ** 2 - band[0] ** 2) / 2)

    expected = [pdp(each) * (each > sensor.bias.onset_v) for each in volts.ravel()]
    np.testing.assert_allclose(found / photons, np.reshape(expected, (6, 7)), rtol=1e-9)


def test_without_a_spectrum_the_factor_is_that_of_flat_light(tmp_path):
    sensor = load_sensor(surface_device(tmp_path, bias="excess_v: 4"))
    whole = [(400.0, 700.0)]
    rates = [
        detection_rate(np.ones((1, 1, 1, 1)), whole, each)[0, 0, 0]
        for each in (sensor, changed(sensor, bias={"excess_v": 1.5}))
    ]
    factor = draw_fixed_pattern(sensor, (1, 1)).efficiency_factor[0, 0]
    assert rates[0] / rates[1] == pytest.approx(factor, rel=1e-12)


def test_effects_can_be_switched_off_on_a_surface(tmp_path):
    sensor = load_sensor(surface_device(tmp_path))
    assert without(sensor, "bias").bias.efficiency_surface is None
    seen = detection_rate(np.ones((1, 2, 2, 1)), [(450, 460)], without(sensor, "efficiency"))
    np.testing.assert_allclose(seen, seen[0, 0, 0], rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "bias", "message"),
    [
        (LINES.replace("500.0,2.0,0.3\n", ""), "excess_v: 2", "500 nm at 2 V is missing"),
        (LINES + "500,2,0.3\n", "excess_v: 2", "line 11: 500 nm at 2 V is given twice"),
        (LINES.replace("0.3\n", "30\n"), "excess_v: 2", "efficiency 30 is not from 0 to 1"),
        ("400,0.1\n500,0.2", "excess_v: 2", "line 1 is not wavelength_nm,excess_v,efficiency"),
        (LINES, "excess_v: 4.5", "covers 1 to 4 V, pixels need 4.5 to 4.5 V"),
        (LINES, "excess_v: 2, efficiency_scale_v: 1", "set one of them to null"),
    ],
)
def test_impossible_surface_is_refused(tmp_path, text, bias, message):
    with pytest.raises(ValueError, match=message):
        detection_rate(
            np.ones((1, 1, 1, 1)),
            [(450, 460)],
            load_sensor(surface_device(tmp_path, text, bias)),
        )


def test_a_curve_of_another_bias_than_the_surface_has_is_refused(tmp_path):
    sensor = load_sensor(surface_device(tmp_path))
    with pytest.raises(ValueError, match=r"is not that of bias\.efficiency_surface"):
        changed(sensor, bias={"reference_v": 2.5})


def test_a_surface_without_its_reference_is_refused(tmp_path):
    path = surface_device(tmp_path)
    path.write_text(path.read_text().replace("reference_v: 1.5, ", ""))
    with pytest.raises(ValueError, match=r"bias\.reference_v: missing"):
        load_sensor(path)
