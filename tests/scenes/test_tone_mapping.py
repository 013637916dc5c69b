import numpy as np

from megalopta.scenes import ToneCurve, preview
from megalopta.scenes.spectra.spectrum import flat

BANDS = ((450.0, 550.0), (550.0, 650.0))


def shade_and_sky():
    """Radiance of things in the shade before a sky a hundred times as bright."""
    rng = np.random.default_rng(1)
    radiance = 1e-9 * rng.lognormal(0, 0.8, (40, 50, 1)) * np.ones(2)
    radiance[:12] = 1e-7
    return radiance.astype(np.float32)


def test_nothing_but_the_brightest_clips_and_order_is_kept():
    radiance = shade_and_sky()
    image = preview(radiance, BANDS, flat(1.0))
    assert image[12:].max() < 250
    assert (image[:12] == 255).all()
    values = radiance[..., 0].ravel()
    gray = image[..., 1].ravel().astype(int)
    assert (np.diff(gray[np.argsort(values)]) >= 0).all()
    # Nor is it left in the dark: half of the shade is above 60 of 255.
    assert np.median(gray[values < 5e-8]) > 60


def test_dark_values_stay_as_they_are_and_an_even_picture_too():
    curve = ToneCurve(level=2.0, brightest=300.0)
    np.testing.assert_allclose(curve(np.array([2e-3, 0.02])), [1e-3, 0.01], rtol=0.02)
    assert curve(np.array([300.0, 400.0])).tolist() == [1, 1]
    even = ToneCurve(level=2.0, brightest=2.0)
    np.testing.assert_allclose(even(np.array([0.5, 1.0, 2.0])), [0.25, 0.5, 1.0])
