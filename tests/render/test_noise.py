import numpy as np
import pytest

from megalopta.render import RenderSettings
from megalopta.render.noise import MeasuredPass, RenderNoise, RunningMean, render_once, render_until
from megalopta.scenes import Light, PerspectiveCamera

from .conftest import down, renderer_of

MEAN = np.array([3.0, 1.0])
COVARIANCE = np.array([[0.04, -0.006], [-0.006, 0.01]])
SIGMA = np.sqrt(COVARIANCE.sum())
BANDS = RenderSettings().bands_nm


def gaussian_pass(number):
    """200 × 200 pixels of known noise."""
    rng = np.random.default_rng([7, number])
    return rng.multivariate_normal(MEAN, COVARIANCE, (200, 200)).astype(np.float32)


def measured_pass(number):
    """Without sky, and with nothing that stands."""
    return under(np.zeros((200, 200), np.float32), gaussian_pass(number))


def under(sky, image=None, standing=None, differences=None):
    """A pass of which the sky is known, and what stands."""
    image = np.zeros((*sky.shape, 2), np.float32) if image is None else image
    return MeasuredPass(image, sky, standing, differences)


def seen_twice(draw):
    """The same error in two sets of samples, without a scatter of their own."""
    return np.stack([draw, draw], axis=2).astype(np.float32)


def passes(count):
    result = RunningMean()
    for number in range(count):
        result.add(gaussian_pass(number))
    return result


@pytest.mark.parametrize(("count", "averaged"), [(2, 8), (8, 1)])
def test_scatter_of_passes_gives_the_known_noise(count, averaged):
    noise = passes(count).noise(averaged)
    # 40 000 pixels: the median of |N(0, 1)| is known to 0.6 % (σ), the variance to 0.7 %; five σ.
    # Dividing by the pixel's own mean adds less than 0.3 %.
    sigma = SIGMA / np.sqrt(averaged)
    assert noise.median_relative == pytest.approx(sigma / MEAN.sum(), rel=0.035)
    assert noise.rms_over_mean == pytest.approx(sigma / MEAN.sum(), rel=0.02)
    scale = np.sqrt(np.outer(*2 * [COVARIANCE.diagonal()])) / averaged
    difference = np.abs(np.array(noise.covariance) - COVARIANCE / averaged) / scale
    assert difference.max() < 5 * np.sqrt(2 / 40_000)
    np.testing.assert_allclose(noise.mean, MEAN, rtol=3e-3)
    exact = np.mean([gaussian_pass(number) for number in range(count)], axis=0)
    np.testing.assert_allclose(passes(count).mean, exact, rtol=1e-6)


def test_passes_stop_at_the_first_that_meets_the_target_or_at_the_cap_but_not_before_the_second():
    sigma = SIGMA / MEAN.sum()
    image, noise = render_until(gaussian_pass, measured_pass, sigma / np.sqrt(5.5), 100)
    assert noise.passes == 6  # σ/√5 is 5 % above the target, σ/√6 4 % below; known to 0.6 %
    np.testing.assert_array_equal(image, passes(6).mean)
    assert render_until(gaussian_pass, measured_pass, 1e-6, 3)[1].passes == 3
    assert render_until(gaussian_pass, measured_pass, 0.9, 3)[1].passes == 2


def test_noise_survives_its_text():
    sky = np.zeros((200, 200), np.float32)
    sky[:90] = 1
    noise = passes(2).noise(1, under(sky, standing=seen_twice(gaussian_pass(5))))
    assert noise.sky
    assert RenderNoise.from_json(noise.to_json()) == noise


def half_sky(scale=8.0):
    """Two passes whose upper half is sky, `scale` times as bright and twice as clean."""
    sky = np.zeros((200, 200), np.float32)
    sky[:100] = 1
    sky[100] = 0.3  # a row of pixels that show both

    def one(number):
        image = gaussian_pass(number).astype(float)
        image[:100] = scale * (MEAN + (image[:100] - MEAN) / 2)
        return image.astype(np.float32)

    result = RunningMean()
    for number in range(2):
        result.add(one(number))
    return result, sky


def test_surfaces_and_sky_are_each_measured_against_their_own_mean():
    both, sky = half_sky()
    noise = both.noise(1, under(sky))
    sigma = SIGMA / MEAN.sum()
    # 20 000 pixels each: a variance from two passes is known to 1 % (σ); five σ
    assert noise.surface.rms == pytest.approx(sigma, rel=0.03)
    assert noise.sky.rms == pytest.approx(sigma / 2, rel=0.03)
    assert noise.surface.share == pytest.approx(99 / 200)
    assert noise.sky.share == pytest.approx(0.5)
    bands = np.sqrt(COVARIANCE.diagonal()) / MEAN
    np.testing.assert_allclose(noise.surface.bands, bands, rtol=0.03)
    np.testing.assert_allclose(noise.mean, MEAN, rtol=5e-3)  # not that of the sky
    assert noise.rms_over_mean == noise.surface.rms
    # An even picture: what neighbors differ by is noise alone.
    assert noise.surface.gradient == pytest.approx(1, rel=0.03)
    assert noise.surface.standing_gradient == 0
    # All blocks have the same σ. The logarithms of halves of 1250 blocks correlate by 0 ± 0.03, so a
    # block's scatter of 18 % is shrunk to 0.37 of it or less (five σ); 1.64 times that.
    assert noise.surface.p95 == pytest.approx(sigma, rel=0.11)


@pytest.mark.parametrize("outlier", [1, 30])
def test_median_of_blocks_is_known_though_two_passes_rarely_meet_most_of_the_noise(outlier):
    rng = np.random.default_rng(14)
    of_blocks = 0.01 * np.exp(0.5 * rng.normal(size=(50, 50)))
    of_blocks[rng.random((50, 50)) < 0.01] *= outlier
    sigma, rate, share = np.kron(of_blocks, np.ones((4, 4))), 0.02, 0.8

    def one():
        # Events of 0.02 in a pixel and pass, 0.6 in a block and two passes, have 0.8 of the variance.
        rare = (rng.poisson(rate, sigma.shape) - rate) / np.sqrt(rate)
        plain = rng.normal(size=sigma.shape)
        light = 10 + sigma * (np.sqrt(1 - share) * plain + np.sqrt(share) * rare)
        return light[..., None].astype(np.float32)

    two = RunningMean()
    for _ in range(2):
        two.add(one())
    # Over twenty seeds the estimate is 2 to 6 % too high and varies by 2.8 % (σ); five σ. The median of
    # the measured variances, corrected for 16 normal pixels, is 26 ± 1.4 % too low.
    assert two.noise(1).median_relative == pytest.approx(np.median(of_blocks) / 10, rel=0.2)


@pytest.mark.parametrize("of_clusters", [0, 1])
def test_an_error_that_stands_is_part_of_the_whole_and_told_apart(of_clusters):
    flicker, sky = passes(2), np.zeros((200, 200), np.float32)
    apart = 0.5 * (gaussian_pass(11) - MEAN)
    # Each set of samples meets clusters of its own, with twice as large an error: not the pixel's.
    draws = [apart + of_clusters * (gaussian_pass(number) - MEAN) for number in (12, 13)]
    standing = np.stack(draws, axis=2).astype(np.float32)
    surface, sigma = flicker.noise(1, under(sky, standing=standing)).surface, SIGMA / MEAN.sum()
    # 40 000 products of a relative deviation of some 5: 2.5 % of the square; five σ of the root
    assert surface.standing == pytest.approx(0.5 * sigma, rel=0.07 if of_clusters else 0.03)
    assert surface.rms == pytest.approx(np.sqrt(1.25) * sigma, rel=0.03)
    if not of_clusters:
        assert surface.median == pytest.approx(np.sqrt(1.25) * sigma, rel=0.03)


def test_what_stands_is_the_distance_from_paths_without_their_scatter():
    flicker, sky = passes(2), np.zeros((200, 200), np.float32)
    rng = np.random.default_rng(12)
    offset = 0.1 * (gaussian_pass(11) - MEAN)
    # Paths scatter by ten times the offset, 8 groups of them by 3.5 times: without their variance
    # the distance would read 3.7 times as much.
    scatter = rng.multivariate_normal(np.zeros(2), COVARIANCE, (200, 200, 8))
    differences = (offset[:, :, None] + scatter).astype(np.float32)
    differences[rng.random((200, 200)) < 0.3] = np.nan  # not compared
    draw = 0.05 * (gaussian_pass(3) - MEAN)  # what the bake knows of it
    measured = under(sky, standing=seen_twice(draw), differences=differences)
    still = flicker.noise(1_000_000, measured)
    sigma = 0.1 * SIGMA / MEAN.sum()
    # D² of 28 000 pixels has a relative deviation of √2 · 13.5 / √28000 = 0.11 of the offset's
    # square: 6 % of its root; five σ
    assert still.surface.standing == pytest.approx(sigma, rel=0.3)
    assert still.surface.rms == pytest.approx(sigma, rel=0.3)
    assert still.surface.median == pytest.approx(sigma, rel=0.4)


def test_the_gradient_of_what_stands_is_known_from_pairs_of_neighbors():
    sky = np.zeros((200, 200), np.float32)
    ramp = RunningMean()
    rows = np.broadcast_to(np.arange(200.0)[:, None, None] * 0.3, (200, 200, 2))
    for _ in range(2):
        ramp.add(rows.astype(np.float32))
    # An error of ±0.06 in every other row: neighbors in columns differ by 0.24 in the sum of the
    # bands, those in rows not at all; the ramp by 0.6.
    stripes = 0.06 * (-1.0) ** np.arange(200)[:, None, None, None]
    noise = np.random.default_rng(13).normal(0, 0.01, (200, 200, 8, 2))
    measured = under(sky, differences=(stripes + noise).astype(np.float32))
    found = ramp.noise(1, measured).surface
    assert found.gradient == pytest.approx(0.24**2 / 0.6**2, rel=0.02)
    assert found.standing_gradient == found.gradient  # passes do not scatter
    assert found.standing == pytest.approx(0.12 / rows.sum(axis=-1).mean(), rel=0.02)


@pytest.mark.parametrize("sampler", ["independent", "multijitter"])
def test_estimated_noise_is_the_true_distance_to_a_converged_rendering(ground, sampler):
    lighting, pose = Light(level="full_moon", disc_fraction=0.3).lighting(), down()[0]
    camera = PerspectiveCamera(width=64, height=64, fov_deg=40)
    given = {"samples_per_pixel": 16, "sampler": sampler, "max_depth": 2, "bands_nm": BANDS}
    renderer = renderer_of(camera, ground, lighting=lighting, **given)
    image, noise = render_once(
        lambda number: renderer.radiance(pose, number),
        lambda number: renderer.measured(pose, number),
    )
    # Every pixel of an even plane has the same mean, known from all of 4096 pixels.
    total = image.sum(axis=-1, dtype=np.float64)
    true = total.std() / total.mean()
    # Two estimates of a σ from 4096 values each: 1.1 % (σ) for normal noise, and up to twice that.
    assert noise.rms_over_mean == pytest.approx(true, rel=0.12)
