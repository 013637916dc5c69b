"""Design by bound: scaling with light, the limits it names, its files."""

import csv
import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from megalopta import design
from megalopta.benchmark.design import DesignScene, DesignSettings, leaves_scene, varied_sensor
from megalopta.cli import main as cli
from megalopta.core.arrays import first_reached
from megalopta.core.errors import UserError
from megalopta.flow.metrics.translation_bound import reading_slopes
from megalopta.scenes import PerspectiveCamera
from megalopta.scenes.levels import illuminance_of
from megalopta.scenes.spectra.spectrum import Spectrum, luminous
from megalopta.sensor import IMAGE_SENSORS, changed, expose_rate, preset, reading_moments

SMALL = {"camera": {"width": 48, "height": 36, "fov_deg": 60}, "block_px": 12}
STEADY = {**SMALL, "yaw_deg_s": 0}
TIMES = {"exposure_s": (1e-4, 1e-3, 1e-2)}


def errors(sensor="ideal", **settings):
    """Errors of flow and of yaw, (points, 2)."""
    return np.array([each[3:] for each in design(sensor, **{**STEADY, **TIMES, **settings}).points])


def test_four_times_the_photons_halve_the_error():
    # photons alone: exact
    found = errors(light_levels=(0.1, 0.4))
    assert found[:3] / found[3:] == pytest.approx(np.full((3, 2), 2.0))
    assert found[0] / found[1] == pytest.approx([math.sqrt(10)] * 2)


def test_a_pixel_gathers_light_as_its_area_and_the_aperture():
    base = errors(light_levels=(0.1,))
    pitch = errors(light_levels=(0.1,), pitch_m=(30e-6,))
    assert pitch / base == pytest.approx(np.full((3, 2), 2.0))
    aperture = errors(light_levels=(0.1,), f_number=(2.8,))
    share = math.sqrt((4 * 2.8**2 + 1) / (4 * 1.4**2 + 1))
    assert aperture / base == pytest.approx(np.full((3, 2), share))
    half = errors(light_levels=(0.1,), pde=(0.5,))
    assert half / base == pytest.approx(np.full((3, 2), math.sqrt(2)))


@pytest.mark.parametrize("level", [0.25, "full_moon", "starlight"])
def test_dead_leaves_have_the_luminance_of_their_reflectance(level):
    """E·ρ/π, from the mean radiance by the CIE curve; bands of 25 nm change it by less than 1 %."""
    scene = leaves_scene(DesignSettings(**SMALL), preset("ideal"))
    mean = scene.radiance(level).mean(axis=(0, 1, 2))
    luminance = luminous(Spectrum.of(np.mean(scene.bands_nm, axis=1), mean))
    assert luminance == pytest.approx(illuminance_of(level) * 0.2 / math.pi, rel=0.01)


def test_eight_frames_determine_a_velocity_84_times_as_well_as_two():
    """Σ(t − t̄)² of 8 frames is 42, of 2 frames ½."""
    found, eight = errors(light_levels=(0.1,)), errors(light_levels=(0.1,), frames=8)
    assert found / eight == pytest.approx(np.full((3, 2), math.sqrt(84)))


def test_dark_counts_are_those_asked_for_in_every_pixel():
    device = varied_sensor(preset("spadcam"), {"dark_counts_hz": 300.0, "pde": 0.05})
    assert device.photon_detection_efficiency([450.0]) == pytest.approx(0.05)
    bare = changed(device, bias=preset("ideal").bias.model_dump(), counter={"kind": "digital"})
    mean, _ = reading_moments(
        np.zeros((1, 4, 4)), changed(bare, exposure_s=1.0, dead_time={"kind": "ideal"})
    )
    assert mean == pytest.approx(np.full((1, 4, 4), 300.0))


def test_a_turn_moves_a_pinhole_image_by_its_closed_form():
    camera = PerspectiveCamera(width=40, height=30, fov_deg=90)
    x, y = np.moveaxis((camera.pixel_centers() - [20, 15]) / 20, -1, 0)
    found = DesignScene(lambda _: np.empty(0), [], camera).flow_per_degree()
    # finite turns of 1e-4 rad
    expected = -20 * np.radians(1) * np.stack([1 + x**2, x * y], axis=-1)
    assert found == pytest.approx(expected, rel=1e-3, abs=1e-4)


@pytest.mark.slow
def test_yaw_estimated_from_drawn_counts_scatters_as_predicted():
    """Maximum likelihood of the turn between a known texture and drawn Poisson counts with dark
    ones. The variance of 4000 estimates scatters by 2.2 %, and 13 % is more than five times that
    (false alarm below 1e-7)."""
    camera = PerspectiveCamera(width=48, height=36, fov_deg=60)
    flow = DesignScene(lambda _: np.empty(0), [], camera).flow_per_degree()
    waves = gaussian_filter(np.random.default_rng(5).standard_normal((36, 48)), 2)
    light = 500 * np.exp(0.5 * waves / waves.std())
    sensor = varied_sensor(changed(preset("ideal"), exposure_s=0.01), {"dark_counts_hz": 300.0})
    predicted = 1 / reading_slopes(light, sensor).of_turn(flow)
    turns = np.linspace(-3, 3, 7) * math.sqrt(predicted)
    coordinates = [
        np.indices(light.shape) - turn * np.moveaxis(flow[..., ::-1], -1, 0) for turn in turns
    ]
    moved = np.array([map_coordinates(light, each, mode="nearest") for each in coordinates])
    means = reading_moments(moved, sensor)[0].reshape(len(turns), -1)
    drawn = expose_rate(np.broadcast_to(light, (4000, 36, 48)), sensor, seed=0, stream=0)
    counts = drawn.counts.reshape(4000, -1).astype(float)
    likelihood = counts @ np.log(means).T - means.sum(axis=1)
    square, linear, _ = np.polyfit(turns, likelihood.T, 2)
    assert np.var(-linear / (2 * square)) == pytest.approx(predicted, rel=0.13)


LIMITS = (
    ("saturation", {"counter": {"capacity": 1}}, {"light_levels": ("daylight",)}),
    ("dark counts", {"dark_counts": {"bulk_mean_hz_um2": 3e4}}, {"light_levels": (0.02,)}),
    ("motion blur", {}, {"light_levels": (0.002,), "yaw_deg_s": 2000, "error": "0.2px"}),
    (
        "read noise",
        {"counter": {"kind": "analog", "step_v": 0.01, "read_noise_v": 0.1, "adc_bits": 12}},
        {"light_levels": (0.01,), "exposure_s": (1e-4, 1e-3)},
    ),
    (
        "saturation, or a texture of one direction",
        {"counter": {"kind": "analog", "step_v": 0.01}},
        {"light_levels": (1e9,)},
    ),
    ("too few photons in a frame", {}, {"light_levels": (1e-6,)}),
    # of a frame camera
    ("read noise", {"read": {"median_e": 30.0}}, {"light_levels": (0.3,)}),
    ("dark current", {"dark": {"mean_e_s": 1e6}}, {"light_levels": (0.3,)}),
    ("saturation", {"full_well_e": 1}, {"light_levels": (100.0,)}),
)


@pytest.mark.parametrize(("cause", "changes", "settings"), LIMITS)
def test_the_cause_that_keeps_an_error_from_being_reached_is_named(cause, changes, settings):
    is_frame = bool(changes.keys() & {"read", "dark", "full_well_e"})
    sensor = changed(IMAGE_SENSORS["orca-quest-2" if is_frame else "ideal"], **changes)
    (row,) = design(sensor, **{**STEADY, **TIMES, **settings}).rows
    assert row.exposure_s is None
    assert row.limit == cause


def test_the_least_exposure_is_found_between_those_tried():
    assert first_reached((1.0, 100.0), np.array([1.0, 0.1]), 0.1**0.5) == pytest.approx(10.0)
    assert first_reached((1.0, 100.0), np.array([1.0, 0.5]), 0.1) is None
    assert first_reached((1.0, 100.0), np.array([np.inf, 0.5]), 0.6) == 100.0


@pytest.mark.parametrize(
    ("sensor", "settings", "words"),
    [
        ("nothing", {}, "unknown"),
        ("ideal", {"error": "0.1"}, "error"),
        ("ideal", {"error": "0px"}, "not positive"),
        ("ideal", {"error": "1e-e5px"}, "error"),
        ("ideal", {"light_levels": ("gloom",)}, "gloom"),
        ("ideal", {"yaw_deg_s": 5000}, "in a frame"),
        ("ideal", {"exposure_s": (1.0,)}, "longer than a frame"),
        ("spadcam", {"pde": (0.2,)}, "fill factor"),
        ("ideal", {"block_px": 100}, "block_px"),
        (changed(preset("ideal"), filters={"mosaic": ("W",)}), {}, "color filters"),
    ],
)
def test_what_cannot_be_designed_is_refused_in_one_sentence(sensor, settings, words):
    with pytest.raises(UserError, match=words) as refused:
        design(sensor, **{**STEADY, **settings})
    assert "\n" not in str(refused.value)


def test_the_command_writes_a_page_and_its_numbers(tmp_path, capsys):
    words = "--light-levels full_moon 1e-6 --exposure-s 0.001 0.01 --f-number 1.4 2 --error 2deg/s"
    camera = "--camera.width 48 --camera.height 36 --block-px 12"
    cli.main(["design", "ideal", "--out", str(tmp_path), *words.split(), *camera.split()])
    assert "too few photons in a frame" in " ".join(capsys.readouterr().out.split())
    with (tmp_path / "design.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert {each["light_level"] for each in rows} == {"full_moon", "1e-06lux"}
    page = (tmp_path / "design.html").read_text()
    assert page.count("<svg") == 2
    assert "exposure for 2 °/s" in page.lower()


def test_a_dataset_is_a_scene_with_its_own_camera(whole):
    settings = {"light_levels": (10.0, 40.0), "exposure_s": (1e-3,), "block_px": 12, "yaw_deg_s": 0}
    dim, bright = design("ideal", whole, **settings).points
    assert dim.error_px / bright.error_px == pytest.approx(2.0)
