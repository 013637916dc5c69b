import numpy as np
import pytest

from megalopta.assets_gen.tileable_noise import plane_waves, tileable_noise

SHAPE, SIZE_M, BAND_M = (128, 192), (2.0, 3.0), (0.1, 0.5)


def test_noise_has_unit_variance_zero_mean_and_only_wavelengths_of_its_band():
    field = tileable_noise(SHAPE, SIZE_M, BAND_M, 1.0, np.random.default_rng(0))
    power = np.abs(np.fft.fft2(field)) ** 2
    fv = np.fft.fftfreq(SHAPE[0], SIZE_M[0] / SHAPE[0])[:, None]
    fu = np.fft.fftfreq(SHAPE[1], SIZE_M[1] / SHAPE[1])
    frequency = np.hypot(fu, fv)
    outside = (frequency < 1 / BAND_M[1] - 1e-9) | (frequency > 1 / BAND_M[0] + 1e-9)
    # Fourier series on the tile's own period: what has only such lines repeats without a seam
    assert power[outside].sum() < 1e-20 * power.sum()
    assert field.mean() == pytest.approx(0, abs=1e-12)
    assert field.std() == pytest.approx(1, rel=1e-12)


def test_stretched_noise_varies_more_slowly_along_the_rows_index():
    field = tileable_noise(SHAPE, SIZE_M, BAND_M, 1.0, np.random.default_rng(0), stretch=4.0)
    along, across = (np.diff(field, axis=axis).std() for axis in (0, 1))
    assert 3 < across / along < 5.5


def test_plane_waves_have_the_rms_asked_for():
    field = plane_waves((2.0, 6.0), 0.4, 30, np.random.default_rng(1))
    assert np.sum(field.amplitudes**2) / 2 == pytest.approx(0.4**2, rel=1e-12)
    points = np.random.default_rng(2).uniform(-3000, 3000, (100_000, 2))
    # 1e5 independent places: the standard error of the rms is below 0.3 %
    assert field(points).std() == pytest.approx(0.4, rel=0.02)
