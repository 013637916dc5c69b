"""Points, noise, marks and leaves that are drawn from seeds."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.assets_gen import TEXTURES, generator
from megalopta.assets_gen.grating import bars, random_dots
from megalopta.assets_gen.scatter import poisson_disk
from megalopta.assets_gen.surface_textures import dead_leaves
from megalopta.assets_gen.tileable_noise import Marks, plane_waves, strew, tileable_noise

LOW, HIGH = np.array([-10.0, 5.0]), np.array([30.0, 25.0])


def test_points_keep_their_distance_and_number_inside_the_box():
    points = poisson_disk(LOW, HIGH, 300, 1.1, np.random.default_rng(0))
    nearest = cKDTree(points).query(points, k=2)[0][:, 1]
    assert points.shape == (300, 2)
    assert nearest.min() >= 1.1
    assert np.all((points >= LOW) & (points <= HIGH))
    with pytest.raises(ValueError, match="spacing_m: 300 points 2 m apart do not fit"):
        poisson_disk(LOW, HIGH, 300, 2.0, np.random.default_rng(0))


def test_every_part_of_the_purpose_and_seed_zero_count():
    keys = [(0, "a"), (1, "a"), (0, "b"), (0, "a", 0), (0, "a", 1), (0, "a", "b")]
    assert len({generator(*key).random() for key in keys}) == len(keys)


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


def test_plane_waves_have_the_rms_asked_for():
    field = plane_waves((2.0, 6.0), 0.4, 30, np.random.default_rng(1))
    assert np.sum(field.amplitudes**2) / 2 == pytest.approx(0.4**2, rel=1e-12)
    points = np.random.default_rng(2).uniform(-3000, 3000, (100_000, 2))
    # 1e5 independent places: the standard error of the rms is below 0.3 %
    assert field(points).std() == pytest.approx(0.4, rel=0.02)


def test_marks_cover_as_independent_places_do():
    marks, rng = Marks((0.1, 0.1), 0.5, 0.3, 0.0), np.random.default_rng(0)
    area = np.mean(np.isfinite(strew((400, 400), (1.0, 1.0), 400, marks, rng)))
    expected = 1 - np.exp(-400 * 2 / 3 * 0.1 * 0.05)
    # coverage of 400 independent marks on the torus: standard deviation below 0.01
    assert area == pytest.approx(expected, abs=0.05)


def test_covariance_is_that_of_the_first_leaf_to_cover_either_of_two_points():
    # Two points share a leaf with probability γ(h)/(2γ(0) − γ(h)), γ the overlap of a leaf with
    # itself shifted by h (Matheron); pixels average 3 × 3 samples.
    radius, size = 3.0, 192
    image = dead_leaves((size, size), np.random.default_rng(4), (radius, radius))
    spectrum = np.abs(np.fft.fft2(image - image.mean())) ** 2
    measured = np.fft.ifft2(spectrum).real / spectrum.mean()

    def shared(x, y):
        half = np.minimum(np.hypot(x, y) / (2 * radius), 1)
        overlap = (2 * np.arccos(half) - 2 * half * np.sqrt(1 - half**2)) / np.pi
        return overlap / (2 - overlap)

    within = np.subtract.outer(np.arange(3), np.arange(3)).ravel() / 3

    def expected(lag):
        return np.mean(shared(lag + within[:, np.newaxis], within))

    # About 192²/(π·3²) = 1300 leaves: ± 0.028, and half of that over the four directions and with
    # the correlation falling; 5 standard deviations are 0.07. Leaves that add up instead of
    # covering each other would have γ(h)/γ(0), which is 0.15 more at h = 3.
    for lag in (1, 2, 3, 4, 8):
        four = [measured[lag, 0], measured[-lag, 0], measured[0, lag], measured[0, -lag]]
        assert np.mean(four) == pytest.approx(expected(lag) / expected(0), abs=0.07)


def test_a_sine_has_its_contrast_and_frequency_alone():
    x = np.arange(240) / 40
    spectrum = np.abs(np.fft.rfft(bars(x, 0.7, 0.4, square=False))) / 240
    assert spectrum[0] == pytest.approx(1, abs=1e-12)
    assert spectrum[6] == pytest.approx(0.35, abs=1e-12)
    assert np.delete(spectrum, [0, 6]).max() < 1e-12


def test_a_square_wave_has_the_odd_harmonics_of_its_fourier_series():
    texels = 4096
    x = (np.arange(texels) + 0.5) / texels
    amplitude = 2 * np.abs(np.fft.rfft(bars(x, 0.5, 0.0, square=True))) / texels
    orders = np.array([1, 3, 5, 7])
    # sampling at 4096 places changes low harmonics by less than (order/4096)²
    np.testing.assert_allclose(amplitude[orders], 0.5 * 4 / np.pi / orders, rtol=1e-4)
    assert amplitude[[2, 4, 6]].max() < 1e-12


def test_random_dots_cover_half_of_the_plane_with_the_covariance_of_a_boolean_model():
    dots = random_dots((1536, 1536), (64.0, 64.0), 1.0, np.random.default_rng(3)) / 2
    # Integral of the Boolean model's covariance over lags is below 0.25·π·0.5² = 0.2 periods², so
    # the mean over 64² periods² scatters by less than 0.7 %; 5 sigma, false alarms below 6e-7.
    assert dots.mean() == pytest.approx(0.5, abs=0.035)
    power = np.abs(np.fft.fft2(dots)) ** 2
    both = np.fft.ifft2(power).real / dots.size
    uncovered = 1 - 2 * dots.mean() + both[0]
    radius, density = 0.25, np.log(2) / (np.pi * 0.25**2)
    lag = np.arange(0, 24) / 24
    half = np.clip(lag / (2 * radius), 0, 1)
    overlap = 2 * radius**2 * (np.arccos(half) - half * np.sqrt(1 - half**2))
    expected = np.exp(-density * (2 * np.pi * radius**2 - overlap))
    # same scatter as of the mean, twice; a texel is 1/24 period
    np.testing.assert_allclose(uncovered[:24], expected, atol=0.07)
    assert abs((uncovered[:24] - uncovered[20:24].mean() - expected + 0.25)[:12]).max() < 0.02


def seam_contrast(image: np.ndarray, axis: int) -> float:
    """Mean step across the image's seam over the largest mean step between rows inside it."""
    rows = np.moveaxis(image.astype(float), axis, 0)
    inside = np.abs(np.diff(rows, axis=0)).mean(axis=1).max()
    return float(np.abs(rows[0] - rows[-1]).mean() / inside)


ATLASES = {"leaf", "needles"}  # squares of separate leaves, which need not tile


@pytest.mark.parametrize("name", TEXTURES)
def test_textures_are_weights_with_contrast_at_every_scale_and_without_a_seam(name):
    texture = TEXTURES[name](np.random.default_rng(7))
    assert texture.dtype == np.float32
    assert texture.min() >= 0 and texture.max() <= 1
    if name not in ATLASES:
        # a step across the seam is no larger than the largest between any two rows inside
        assert max(seam_contrast(texture, axis) for axis in (0, 1)) <= 1.05
    image = texture.astype(float)
    while min(image.shape) > 32:
        blocks = image.reshape(image.shape[0] // 2, 2, image.shape[1] // 2, 2)
        coarse = blocks.mean(axis=(1, 3))
        assert (image - coarse.repeat(2, axis=0).repeat(2, axis=1)).std() > 0.02
        image = coarse
