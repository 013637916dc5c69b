"""Lens, color filters and efficiency curves: from radiance to detected photons."""

import numpy as np
import pytest
from scipy.integrate import quad

from megalopta.sensor import (
    PRESETS,
    ColorFilters,
    Efficiency,
    Lens,
    changed,
    demosaiced,
    detection_rate,
    load_sensor,
    optics,
    photon_rate,
    preset,
)

CURVE = Efficiency(wavelengths_nm=(380, 450, 470, 620, 900), values=(0.02, 0.3, 0.21, 0.5, 0.0))


def seen(band, *curves):
    """Integral of the photons in a band that pass curves, each of which is linear between points."""
    points = [nm for curve in curves for nm in curve.wavelengths_nm if band[0] < nm < band[1]]

    def passing(nm):
        return nm * np.prod([np.interp(nm, curve.wavelengths_nm, curve.values) for curve in curves])

    return quad(passing, *band, points=points or None, epsabs=0, epsrel=1e-13)[0]


@pytest.mark.parametrize(
    "band", [(380.0, 900.0), (400.0, 440.0), (449.0, 451.0), (469.999, 620.001), (600.0, 601.0)]
)
def test_band_mean_equals_numerical_integral(band):
    expected = seen(band, CURVE) / seen(band)
    assert optics.band_means([CURVE], [band])[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("band", [(379.0, 500.0), (500.0, 900.5), (1000.0, 1100.0)])
def test_band_outside_the_curve_is_refused_with_both_ranges(band):
    with pytest.raises(ValueError, match=rf"{band[0]:g}–{band[1]:g} nm.*380–900 nm"):
        optics.band_means([CURVE], [band])


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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("400,1\n500,20", "line 2: efficiency 20 is not from 0 to 1; divide percents by 100"),
        ("400,0.1\n400,0.1", "line 2: .*400 nm follows 400; sort"),
        ("0,0.1\n400,0.1", "positive wavelengths"),
        ("400;0.1\n500;0.2", "line 1 is not wavelength_nm,efficiency"),
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


def test_check_beam_gives_396_photons_per_square_micrometer_and_second():
    # dissertation §2.4.5: 17.5 nW over 100 mm² at 450 nm, monochromator resolution 2 nm. The exact
    # figure is 396.44; the thesis prints it without decimals.
    irradiance = 17.5e-9 / 100e-6 / 2.0
    per_square_micrometer = optics.photon_flux([irradiance], [(449.0, 451.0)])[0] * 1e-12
    one_photon = 1.98644586e-25 / 450e-9
    assert per_square_micrometer == pytest.approx(17.5e-9 / one_photon / 100e6, rel=1e-12)
    assert round(per_square_micrometer) == 396


@pytest.mark.parametrize(
    ("bands", "message"),
    [
        ([400.0, 700.0], "shape"),
        ([(700.0, 400.0)], "lower before upper"),
        ([(0.0, 400.0)], "positive"),
        ([(400.0, np.nan)], "finite"),
        ([(500.0, 600.0), (400.0, 501.0)], "overlap"),
    ],
)
def test_bands_that_make_no_sense_are_refused(bands, message):
    with pytest.raises(ValueError, match=message):
        optics.check_bands(bands)


@pytest.mark.parametrize("blur_px", [0.5, 0.6, 2.0, 7.0])
def test_blur_spreads_a_point_by_its_standard_deviation_and_keeps_its_light(blur_px):
    image = np.zeros((2, 81, 101))
    image[:, 40, 50] = 1.0
    spread = optics.blurred(image, blur_px)
    assert spread.sum(axis=(1, 2)) == pytest.approx(1.0, rel=1e-12)
    for axis, middle in ((1, 40), (2, 50)):
        places = np.arange(image.shape[axis]) - middle
        profile = spread[0].sum(axis=2 - axis)
        assert profile @ places**2 == pytest.approx(blur_px**2, rel=1e-6)


def test_blur_of_pixels_is_that_of_the_finer_image_within_what_is_stated():
    # edges at random places: the same lens on an image of eightfold resolution
    rng, fold, side = np.random.default_rng(5), 8, 96
    fine = np.zeros((side * fold, side * fold))
    for _ in range(300):
        (top, left), size = rng.integers(0, side * fold, 2), rng.integers(4, 20 * fold, 2)
        fine[top : top + size[0], left : left + size[1]] = rng.random()
    inner = slice(12, -12)

    def pooled(image):
        return image.reshape(side, fold, side, fold).mean(axis=(1, 3))

    for blur_px, stated in ((0.5, 0.12), (1.0, 0.025), (1.5, 0.01)):
        true = pooled(optics.blurred(fine[np.newaxis], blur_px * fold)[0])[inner, inner]
        coarse = optics.blurred(pooled(fine)[np.newaxis], blur_px)[0, inner, inner]
        assert (coarse - true).std() < stated * true.std()


def test_photons_and_detections_are_those_of_the_blurred_light():
    sensor = PRESETS["ideal"]
    soft = changed(sensor, lens=sensor.lens.model_copy(update={"blur_m": 2 * sensor.pitch_m}))
    light = np.random.default_rng(2).random((2, 20, 30, 1))
    for rate in (photon_rate, detection_rate):
        sharp = rate(light, [(500, 600)], sensor)
        np.testing.assert_allclose(
            rate(light, [(500, 600)], soft), optics.blurred(sharp, 2.0), rtol=1e-9
        )


@pytest.mark.parametrize("pixels", [0.3, 101])
def test_blur_that_pixels_cannot_show_is_refused(pixels):
    sensor = PRESETS["ideal"]
    with pytest.raises(ValueError, match=r"lens\.blur_m: .* m; pixels of .* m show blur from"):
        changed(sensor, lens=Lens(blur_m=pixels * sensor.pitch_m))


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


PDP, GLASS = ({"wavelengths_nm": (300, 1100), "values": pair} for pair in ((0.2, 0.6), (0.9, 0.5)))


def shares(filters):
    """Detections behind filters relative to those without, of even light."""
    sensor = changed(IDEAL, filters=filters, efficiency=PDP, lens={"transmission_curve": GLASS})
    bare = changed(sensor, filters=ColorFilters())
    return (detection_rate(GRAY, BANDS, sensor) / detection_rate(GRAY, BANDS, bare))[0]


@pytest.mark.parametrize("filters", [BAYER, RGBW], ids=["RGGB", "RGBW"])
def test_a_flat_field_shows_the_integral_of_every_filter(filters):
    seen, letters = shares(filters), filters.places((8, 8))

    def detected(*curves):
        def integrand(nm):
            return nm * np.prod([np.interp(nm, *curve.values()) for curve in curves])

        return quad(integrand, 450, 640, points=[500, 520], epsabs=0)[0]

    total = detected(PDP, GLASS)
    for letter, name in {"R": "red", "G": "green", "B": "blue"}.items():
        share = detected(PDP, GLASS, CURVES[name]) / total
        np.testing.assert_allclose(seen[letters == letter], share, rtol=1e-12)
    np.testing.assert_allclose(seen[letters == "W"], 1, rtol=1e-12)


@pytest.mark.parametrize("mosaic", [("RG", "GB"), ("BG", "GR"), ("GR", "BG"), ("GB", "RG")])
def test_even_colors_come_back_from_their_mosaic(mosaic):
    filters, colors = ColorFilters(mosaic=mosaic, **CURVES), np.array([3.0, 400.0, 20.25])
    mosaiced = np.select([filters.places((6, 10)) == letter for letter in "RGB"], colors)
    interpolated = demosaiced(np.stack([mosaiced, 2 * mosaiced]), filters)
    assert interpolated.shape == (2, 6, 10, 3)
    # 16 bits of the largest value
    np.testing.assert_allclose(
        interpolated[0], np.broadcast_to(colors, (6, 10, 3)), atol=800 / 65535
    )
    np.testing.assert_allclose(interpolated[1], 2 * interpolated[0], atol=1600 / 65535)


def test_curves_come_from_files_next_to_the_sensor(tmp_path):
    (tmp_path / "red.csv").write_text("300,0\n1100,0.8\n")
    (tmp_path / "own.yaml").write_text(
        "{preset: ideal, filters: {mosaic: [RW, WR], red: {path: red.csv}}}"
    )
    filters = load_sensor(tmp_path / "own.yaml").filters
    assert filters.red == BAYER.red
    assert filters.white is None


@pytest.mark.parametrize("filters", [RGBW, ColorFilters()], ids=["RGBW", "none"])
def test_a_mosaic_that_opencv_cannot_interpolate_is_refused(filters):
    with pytest.raises(ValueError, match="OpenCV interpolates RGGB, BGGR, GRBG, GBRG"):
        demosaiced(np.ones((1, 4, 4)), filters)
