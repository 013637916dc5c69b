import numpy as np
import pytest

from megalopta.config.model import load
from megalopta.render import neighbor_differences
from megalopta.sensor import IMAGE_SENSORS, changed, detected_photons, expectation
from megalopta.stages.noise_warning import LIMIT, noise_warning, variances

SETTINGS = load(
    "demo", {"camera.width": "200", "camera.height": "200", "render.target_error": "null"}
)
BANDS = SETTINGS.render.bands_nm
MEAN = 1e-9 * np.array([4.0, 3.0, 2.0, 1.0])
NOISE = 1e-10 * np.array([[3, 0, 0, 0], [-1, 2, 0, 0], [0, -1, 2, 0], [0, 0, -1, 1]])
RECORD = {
    "mean": MEAN.tolist(),
    "covariance": (NOISE @ NOISE.T).tolist(),
    "median_relative": 0.04,
    "rms_over_mean": 0.05,
    "samples_per_pixel": [49, 49],
}


@pytest.fixture(scope="module")
def sensors(tmp_path_factory):
    """Presets, and a device with maps of 24 × 20 pixels."""
    folder = tmp_path_factory.mktemp("device")
    rng = np.random.default_rng(1)
    np.save(folder / "dark.npy", rng.uniform(0, 500, (20, 24)))
    np.save(folder / "efficiency.npy", rng.uniform(0.2, 1.5, (20, 24)))
    maps = {"dark_counts": str(folder / "dark.npy"), "efficiency": str(folder / "efficiency.npy")}
    lens = {"falloff_fov_deg": 75}
    measured = changed(IMAGE_SENSORS["spadcam"], measured=maps, lens=lens)
    return {**IMAGE_SENSORS, "measured": measured}


@pytest.mark.parametrize("name", ["ideal", "spadcam", "measured"])
def test_share_is_that_of_noisy_light_run_through_the_sensor(sensors, name):
    sensor, scale = sensors[name], np.array([1.0, 2.0, 0.5, 3.0])
    settings = load("demo", {"camera.width": "24", "camera.height": "20"})
    rendering, shot, detail = variances(RECORD, settings, sensor, scale)
    share = rendering / (shot + detail)
    normal = np.random.default_rng(3).standard_normal((400, 20, 24, 4))
    readings = detected_photons((normal @ NOISE.T + MEAN) * scale, BANDS, sensor)
    dark = expectation(np.zeros((1, 20, 24, 4)), BANDS, sensor).mean_events.mean()
    # 480 pixels with 400 draws each know their mean variance to 0.4 % (σ), a few of them weighing
    # most; five σ
    expected = readings.var(axis=0, ddof=1).mean() / (readings.mean() + dark)
    assert share == pytest.approx(expected, rel=0.02)


def test_noise_that_is_faint_beside_the_scenes_detail_does_no_harm_however_bright_the_light():
    detail = (20 * np.array(RECORD["covariance"])).tolist()
    sensor = IMAGE_SENSORS["ideal"]
    detailed = {**RECORD, "detail": detail}
    parts = [variances(detailed, SETTINGS, sensor, f * np.ones(4)) for f in (1, 1e3, 1e5)]
    shares = [rendering / (shot + fine) for rendering, shot, fine in parts]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1 / 20, rel=1e-3)


def test_detail_is_what_neighbors_differ_by_beyond_noise():
    """White noise alone has no detail; a ramp of slope s has s² / 2 between neighbors."""
    draw = np.random.default_rng(5).standard_normal((300, 300, 4)) @ (1e9 * NOISE).T
    half = neighbor_differences(draw, np.ones((300, 300), bool))
    # 90 000 pixels in 180 000 differences know a variance to about 0.6 % (σ); five of them.
    np.testing.assert_allclose(np.diag(half), np.diag(1e18 * NOISE @ NOISE.T), rtol=0.03)
    ramp = np.broadcast_to(0.5 * np.arange(40.0), (30, 40))[..., np.newaxis]
    along, across = 30 * 39, 29 * 40
    expected = 0.5**2 / 2 * along / (along + across)
    assert neighbor_differences(ramp, np.ones((30, 40), bool)) == pytest.approx(expected, rel=1e-12)


def test_warning_names_samples_that_are_enough_and_harmless_noise_goes_unmentioned():
    assert noise_warning(RECORD, SETTINGS, {"ideal at twilight": LIMIT}) is None
    shares = {"ideal at 0.5lux": 4 * LIMIT, "spadcam at 0.5lux": LIMIT}
    text = noise_warning(RECORD, SETTINGS, shares)
    assert "in 1 of 2 exposures: ideal at 0.5lux 0.63 (" in text
    assert "use render.samples_per_pixel 200, now 49" in text  # 4 × 49 in two digits
    render = SETTINGS.render.model_copy(update={"target_error": 0.05})
    adaptive = SETTINGS.model_copy(update={"render": render})
    text = noise_warning(RECORD, adaptive, {"ideal at twilight": 4 * LIMIT})
    assert "use render.target_error 0.025" in text
