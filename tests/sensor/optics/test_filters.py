"""Color filters: light behind each of them, and colors from a mosaic."""

import numpy as np
import pytest

from megalopta.sensor import (
    ColorFilters,
    changed,
    check_sensor,
    ctia_preset,
    demosaiced,
    detected_photons,
    detection_rate,
    expose,
    load_sensor,
    preset,
)

CURVES = {
    "red": {"wavelengths_nm": (300, 1100), "values": (0.0, 0.8)},
    "green": {"wavelengths_nm": (300, 500, 1100), "values": (0.1, 0.9, 0.2)},
    "blue": {"wavelengths_nm": (300, 1100), "values": (0.9, 0.0)},
}
BAYER = ColorFilters(mosaic=("RG", "GB"), **CURVES)
RGBW = ColorFilters(mosaic=("WRWG", "RWGW", "WGWB", "GWBW"), **CURVES)
IDEAL = preset("ideal")
BANDS = [(450.0, 520.0), (520.0, 640.0)]
GRAY = np.full((1, 8, 8, 2), 1e-3)


def shares(filters):
    """Detections behind filters relative to those without, of even light."""
    sensor = changed(
        IDEAL,
        filters=filters,
        efficiency={"wavelengths_nm": (300, 1100), "values": (0.2, 0.6)},
        lens={"transmission_curve": {"wavelengths_nm": (300, 1100), "values": (0.9, 0.5)}},
    )
    bare = changed(sensor, filters=ColorFilters())
    return (detection_rate(GRAY, BANDS, sensor) / detection_rate(GRAY, BANDS, bare))[0]


def polynomial_share(curve):
    """Share of detections behind a filter: the integrals of λ·PDP·T_lens·T_filter in closed form.

    Curves are linear within 450 to 500, 500 to 520 and 520 to 640 nm, their product a polynomial.
    """
    line = np.polynomial.Polynomial

    def straight(values, wavelengths=(300, 1100)):
        slope = (values[1] - values[0]) / (wavelengths[1] - wavelengths[0])
        return line([values[0] - slope * wavelengths[0], slope])

    seen = line([0, 1]) * straight((0.2, 0.6)) * straight((0.9, 0.5))
    total = np.zeros(2)
    for low, high in ((450, 500), (500, 520), (520, 640)):
        place = max(np.searchsorted(curve["wavelengths_nm"], high) - 1, 0)
        own = straight(*(curve[name][place : place + 2] for name in ("values", "wavelengths_nm")))
        whole = (seen.integ(), (seen * own).integ())
        total += [each(high) - each(low) for each in whole]
    return total[1] / total[0]


@pytest.mark.parametrize("filters", [BAYER, RGBW], ids=["RGGB", "RGBW"])
def test_a_flat_field_shows_the_integral_of_every_filter(filters):
    seen, letters = shares(filters), filters.places((8, 8))
    for letter, name in {"R": "red", "G": "green", "B": "blue"}.items():
        np.testing.assert_allclose(
            seen[letters == letter], polynomial_share(CURVES[name]), rtol=1e-12
        )
    np.testing.assert_allclose(seen[letters == "W"], 1, rtol=1e-12)


def test_the_mosaic_begins_at_the_first_pixel_and_repeats():
    assert BAYER.places((3, 5)).tolist() == [list("RGRGR"), list("GBGBG"), list("RGRGR")]


@pytest.mark.parametrize("mosaic", [("RG", "GB"), ("BG", "GR"), ("GR", "BG"), ("GB", "RG")])
def test_even_colors_come_back_from_their_mosaic(mosaic):
    filters, colors = ColorFilters(mosaic=mosaic, **CURVES), np.array([3.0, 400.0, 20.25])
    mosaiced = np.select([filters.places((6, 10)) == each for each in "RGB"], colors)
    found = demosaiced(np.stack([mosaiced, 2 * mosaiced]), filters)
    assert found.shape == (2, 6, 10, 3)
    # 16 bits of the largest value
    np.testing.assert_allclose(found[0], np.broadcast_to(colors, (6, 10, 3)), atol=800 / 65535)
    np.testing.assert_allclose(found[1], 2 * found[0], atol=1600 / 65535)


def test_counts_of_a_flat_field_give_its_colors():
    sensor = changed(IDEAL, filters=BAYER)
    light = np.full((1, 64, 64, 2), 1e-3)
    rate = detection_rate(light, BANDS, sensor)[0] * sensor.exposure_s
    counts = expose(light, BANDS, sensor, seed=3, stream="flat").counts
    means = demosaiced(counts, BAYER)[0, 1:-1, 1:-1].mean(axis=(0, 1))
    letters = BAYER.places((64, 64))
    for letter, mean in zip("RGB", means, strict=True):
        expected = rate[letters == letter].mean()
        # 62 × 62 values from at least 960 counted pixels: false alarms below 6e-7
        assert abs(mean - expected) < 5 * np.sqrt(expected / 900) + 1e-4 * expected


def test_an_integrating_sensor_has_filters_too():
    sensor = changed(ctia_preset("ctia_si"), filters=BAYER)
    seen = detected_photons(GRAY, [(700.0, 750.0), (750.0, 800.0)], sensor)[0]
    assert len(np.unique(seen)) == 3


def test_curves_come_from_files_next_to_the_sensor(tmp_path):
    (tmp_path / "red.csv").write_text("300,0\n1100,0.8\n")
    (tmp_path / "own.yaml").write_text(
        "{preset: ideal, filters: {mosaic: [RW, WR], red: {path: red.csv}}}"
    )
    filters = load_sensor(tmp_path / "own.yaml").filters
    assert filters.red == BAYER.red
    assert filters.white is None


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mosaic": ("RG", "G")}, "differ in length; fill them up"),
        ({"mosaic": ("RG", "GX")}, "pattern"),
        ({"mosaic": ("RG", "GB"), "red": CURVES["red"]}, "green: G has no curve"),
        ({"mosaic": ("W",), "red": CURVES["red"]}, "red: R is in no row of the mosaic"),
    ],
)
def test_impossible_mosaic_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        ColorFilters(**fields)


def test_a_band_outside_a_filter_is_refused():
    filters = ColorFilters(mosaic=("R",), red={"wavelengths_nm": (500, 600), "values": (1, 1)})
    with pytest.raises(ValueError, match="outside the filters curve, 500–600 nm"):
        check_sensor(changed(IDEAL, filters=filters), [(490.0, 550.0)], (2, 2))


@pytest.mark.parametrize("filters", [RGBW, ColorFilters()], ids=["RGBW", "none"])
def test_a_mosaic_that_opencv_cannot_interpolate_is_refused(filters):
    with pytest.raises(ValueError, match="OpenCV interpolates RGGB, BGGR, GRBG, GBRG"):
        demosaiced(np.ones((1, 4, 4)), filters)
