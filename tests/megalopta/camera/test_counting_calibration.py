"""Recordings of other cameras to a device file, through the command line's door."""

import re

import numpy as np
import pytest

from megalopta.camera.calibrating import calibrate_recordings, listed_sources, named_sources
from megalopta.camera.calibration import primary
from megalopta.camera.recording import Beam, Source
from megalopta.core.errors import UserError
from megalopta.sensor import changed, expose_rate, load_sensor, preset, reading_moments
from megalopta.sensor.calibrate.counting import calibrate_counts
from megalopta.sensor.calibrate.sums import summed
from megalopta.sensor.calibrate.telegraph import correlation
from megalopta.sensor.effects.crosstalk import neighborhoods
from megalopta.sensor.formats.recorded_frames import tiff_writer
from megalopta.sensor.spad.device import draw_fixed_pattern

SHAPE = (12, 16)
DARK_HZ, EFFICIENCY = 400.0, 0.3


def lines(*entries):
    """A list of recordings."""
    return "recordings:\n" + "".join(f"  - {{{each}}}\n" for each in entries)


def save(path, counts):
    """Write counts as a stack, or as an array."""
    if path.suffix == ".npy":
        np.save(path, counts.astype(np.uint16))
        return
    with tiff_writer(path, counts.nbytes, 1.0) as write:
        write(counts.astype(np.uint16))


def written(folder, name, mean, capacity=None):
    """Poisson counts in a file."""
    rng = np.random.default_rng(len(name))
    counts = np.clip(rng.poisson(mean * np.ones((400, *SHAPE))), None, capacity)
    save(folder / f"{name}.tif", counts)


def exposed(folder, sensor, frames, shape, light, suffix="npy"):
    """Dark frames and lit ones, written as a sensor counts them."""
    for name, hz in (("dark", 0.0), ("flat", light)):
        rate = np.full((frames, *shape), EFFICIENCY * hz)
        counts = expose_rate(rate, sensor, seed=1, stream=name).counts
        save(folder / f"{name}.{suffix}", counts)


def calibrated(folder, *entries):
    """Device file, what is told of it, and the page, from a list of recordings in a folder."""
    (folder / "list.yaml").write_text(lines(*entries), "utf-8")
    sources, out = named_sources([str(folder / "list.yaml")]), folder / "device.yaml"
    told = calibrate_recordings(sources, out, beam=Beam(600.0), base="ideal")
    return load_sensor(out), told, out.with_suffix(".html").read_text("utf-8")


def test_counts_give_a_device_that_sense_can_use(tmp_path):
    written(tmp_path, "dark", DARK_HZ * 0.02)
    written(tmp_path, "flat", DARK_HZ * 1e-3 + EFFICIENCY * 2e4 * 1e-3)
    device, sentence, page = calibrated(
        tmp_path,
        "path: dark.tif, exposure_s: 0.02",
        "path: flat.tif, exposure_s: 0.001, light: 2.0e+4",
    )
    assert "192 pixels, 0 bad, 0 hot" in sentence
    assert "dead time: needs counts under two lights" in sentence
    counts = expose_rate(np.zeros((300, *SHAPE)), device, seed=1, stream="dark").counts
    # 2.3 million dark counts of a device calibrated with 0.6 million, 0.15 %: six errors
    assert counts.mean() / device.exposure_s == pytest.approx(DARK_HZ, rel=0.009)
    assert "efficiency (%)" in page
    assert np.load(tmp_path / "device" / "bad.npy").sum() == 0


def test_the_page_has_the_figures_of_emva_1288(tmp_path):
    lights = [6e4 * step for step in range(1, 17)]  # 288 counts at most
    listed = ["path: dark.tif, exposure_s: 0.001"]
    written(tmp_path, "dark", DARK_HZ * 1e-3)
    for at, light in enumerate(lights):
        mean = DARK_HZ * 1e-3 + EFFICIENCY * light * 1e-3
        written(tmp_path, f"flat{at}", mean, capacity=255)
        listed.append(f"path: flat{at}.tif, exposure_s: 0.001, light: {light:.1e}")
    _, _, page = calibrated(tmp_path, *listed)
    row = re.search(r"quantum efficiency \(%\)</td>\s*<td>([\d.]+)</td>\s*<td>([\d.]+)</td>", page)
    of_device, recordings = map(float, row.groups())
    assert of_device == pytest.approx(100 * EFFICIENCY, rel=0.005)
    # the gain of 11 levels of 76800 readings: 5 · √(2/76800) at the brightest, which weighs most
    assert recordings == pytest.approx(100 * EFFICIENCY, rel=0.026)


def test_hot_pixels_give_the_crosstalk_of_pairs_of_rows(tmp_path):
    pairs = np.zeros((2, 1, 3, 3))
    pairs[0, 0, 2, 1] = pairs[1, 0, 0, 1] = 3.0
    pairs[:, :, 1, [0, 2]] = 1.0
    rng, shape = np.random.default_rng(1), (64, 80)
    own = np.where(rng.random(shape) < 0.05, rng.lognormal(5, 1, shape), rng.normal(4, 0.5, shape))
    np.save(tmp_path / "own.npy", own / 1e-3)
    true = changed(
        preset("ideal"),
        exposure_s=1e-3,
        crosstalk={"mean_fired_neighbors": 0.03, "kernel": pairs.tolist()},
        measured={"dark_counts": str(tmp_path / "own.npy")},
    )
    exposed(tmp_path, true, 400, shape, 5e4, "tif")
    found, _, page = calibrated(
        tmp_path,
        "path: dark.tif, exposure_s: 0.001",
        "path: flat.tif, exposure_s: 0.001, light: 5.0e+4",
    )
    chances = neighborhoods(found.crosstalk).mean(axis=1)
    # 0.018 to the partner, nothing to the other row; a tenth of it
    assert chances[0, 4, 3] == pytest.approx(0.018, abs=0.002)
    assert chances[0, 2, 3] == pytest.approx(0, abs=0.002)
    # the device's own dark counts, of which a median pixel has 4 · 400: 5 errors
    primary = np.load(tmp_path / "device" / "dark_counts.npy") * 1e-3
    assert np.median(primary - own) == pytest.approx(0, abs=5 * 0.1 / np.sqrt(own.size) + 0.02)
    again = reading_moments(np.zeros((1, *shape)), changed(found, exposure_s=1e-3))[0][0]
    assert again.mean() == pytest.approx(
        reading_moments(np.zeros((1, *shape)), true)[0].mean(), rel=0.01
    )
    assert "the pixel below" in page


@pytest.mark.parametrize("nm", [5000.0, 1.0])
def test_a_wavelength_without_efficiency_is_refused(tmp_path, nm):
    np.save(tmp_path / "flat.npy", np.ones((60, 4, 4), np.uint16))
    source = Source(tmp_path / "flat.npy", 1e6, 1e-3)
    with pytest.raises(UserError, match=rf"--wavelength-nm {nm:g}: sensor 'ideal' has no eff"):
        calibrate_recordings([source], tmp_path / "x.yaml", beam=Beam(nm), base="ideal")


def test_an_exposure_without_light_tells_how_to_write_it():
    with pytest.raises(UserError, match=r"'dark\.npy:1e-2': give RECORDING@LIGHT:EXPOSURE_S"):
        Source.parse("dark.npy:1e-2")


def test_coincidences_give_crosstalk_and_rates_without_it(tmp_path):
    dark = {"bulk_mean_hz_um2": 0.2, "bulk_sigma_hz_um2": 0.04}
    crosstalk = {"mean_fired_neighbors": 0.04}
    true = changed(preset("ideal"), exposure_s=2e-3, dark_counts=dark, crosstalk=crosstalk)
    exposed(tmp_path, true, 400, (48, 48), 1e4)
    listed = "path: dark.npy, exposure_s: 0.002", "path: flat.npy, exposure_s: 0.002, light: 1.0e+4"
    found, _, _ = calibrated(tmp_path, *listed)
    # coincidences of 400 frames of 2304 pixels: 0.0007 for each of six offsets, twice; 5 errors
    assert found.crosstalk.mean_fired_neighbors == pytest.approx(0.04, abs=0.012)
    own = draw_fixed_pattern(true, (48, 48)).dark_counts_hz
    primary = np.load(tmp_path / "device" / "dark_counts.npy")
    # 1.3 million dark counts, 0.1 %, and the error of the crosstalk
    assert primary.mean() == pytest.approx(own.mean(), rel=0.015)
    assert not found.afterpulsing.is_on


@pytest.mark.slow
def test_intervals_cover_as_stated_with_crosstalk():
    shape, covered = (48, 48), []
    dark = {"bulk_mean_hz_um2": 0.2, "bulk_sigma_hz_um2": 0.04}
    for seed in range(6):
        true = changed(preset("ideal"), device_seed=seed, dark_counts=dark,
                       crosstalk={"mean_fired_neighbors": 0.04})  # fmt: skip
        efficiency = EFFICIENCY * np.random.default_rng(seed).uniform(0.9, 1.1, shape)
        levels = []
        for seconds, light in ((2e-3, 0.0), (2e-4, 0.0), (2e-4, 2e5)):
            rate = np.broadcast_to(light * efficiency, (300, *shape))
            own, name = changed(true, exposure_s=seconds), f"{seconds} {light}"
            counts = expose_rate(rate, own, seed=seed, stream=name).counts
            levels.append(summed(counts, seconds, light, is_binary=False))
        found = calibrate_counts(levels)
        own = draw_fixed_pattern(true, shape).dark_counts_hz
        for estimate, truth in ((found.dark_counts_hz, own), (found.efficiency, efficiency)):
            held = primary(estimate, found.kernel)
            covered.append(((held.low <= truth) & (truth <= held.high)).mean())
    # 13 824 pixels, and an error of the crosstalk that those of a device share: 95.4 and 95.0 %
    assert 0.93 < np.mean(covered[::2]) < 0.97
    assert 0.93 < np.mean(covered[1::2]) < 0.97


def test_bad_pixels_of_the_recordings_are_those_of_the_simulation(tmp_path):
    trap = {"share": 0.01, "step": 8.0, "fastest_s": 0.05, "slowest_s": 0.05}
    dark = {"bulk_mean_hz_um2": 5.0, "bulk_sigma_hz_um2": 0.5}
    true = changed(preset("ideal"), exposure_s=0.01, dark_counts=dark, telegraph=trap)
    exposed(tmp_path, true, 2000, (24, 24), 2e4)
    for name in ("dark", "flat"):
        counts = np.load(tmp_path / f"{name}.npy")
        counts[:, 3, 4], counts[:, 5, 6] = 0, 70
        np.save(tmp_path / f"{name}.npy", counts)
    listed = "path: dark.npy, exposure_s: 0.01", "path: flat.npy, exposure_s: 0.01, light: 2.0e+4"
    device, _, page = calibrated(tmp_path, *listed)
    found = changed(device, exposure_s=0.01)
    again = expose_rate(np.zeros((2000, 24, 24)), found, seed=2, stream="again").counts
    np.testing.assert_array_equal(again[:, 3, 4], 0)
    np.testing.assert_array_equal(again[:, 5, 6], 70)
    before, after = (
        correlation(each, np.ones((24, 24), bool)).is_telegraph
        for each in (np.load(tmp_path / "dark.npy"), again)
    )
    np.testing.assert_array_equal(before, after)
    assert before.sum() > 2
    assert "telegraph" in page


@pytest.mark.parametrize("n", [1, 255])
def test_bits_and_sums_of_bits_give_a_binary_device(tmp_path, n):
    rng, frames = np.random.default_rng(2), (2000, 2000) if n == 1 else (1, 4)  # 1: no scatter
    for name, mean, number in zip(("dark", "flat"), (0.02, 0.42), frames, strict=True):
        sums = rng.binomial(n, -np.expm1(-mean), (number, *SHAPE)).astype(np.uint16)
        np.save(tmp_path / f"{name}.npy", np.packbits(sums > 0, axis=-1) if n == 1 else sums)
    how = "frames: [0, 1500], format: packed_npy" if n == 1 else "sums: 255"
    device, sentence, _ = calibrated(
        tmp_path,
        f"path: dark.npy, exposure_s: 0.0001, {how}",
        f"path: flat.npy, exposure_s: 0.0001, light: 1.0e+4, {how}",
    )
    assert "bits do not show it" in sentence
    assert device.counter.capacity == 1
    # 192 pixels, 1500 bits: 0.25 % of the efficiency; 1020 of the sums 0.36 %; six of them. Of 1500
    # and 255 bits, 1.3 and 3.2 % of the dark counts.
    efficiency, dark_hz = (
        np.load(tmp_path / "device" / f"{each}.npy").mean()
        for each in ("efficiency", "dark_counts")
    )
    assert efficiency == pytest.approx(0.4, rel=0.015 if n == 1 else 0.022)
    assert dark_hz == pytest.approx(200, rel=0.08 if n == 1 else 0.19)


def test_sums_of_a_camera_of_codes_are_refused(tmp_path):
    (tmp_path / "frames.bin").write_bytes(b"")
    with pytest.raises(UserError, match="sums: of recordings of SPADCAM"):
        calibrate_recordings([Source(tmp_path, sums=255)], tmp_path / "out.yaml", beam=Beam())


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("exposure_s", lines("path: dark.tif, exposure_s: 0")),
        ("frames", lines("path: dark.tif, frames: [10, 10]")),
        ("recordings", "recordings: []"),
        ("lens", lines("path: dark.tif, lens: 2")),
        ("sums", lines("path: dark.tif, sums: 1")),
        ("no such file", lines("path: nothing.tif, exposure_s: 1")),
    ],
)
def test_lists_are_checked(words, text, tmp_path):
    (tmp_path / "list.yaml").write_text(text, "utf-8")
    with pytest.raises(UserError, match=words):
        calibrate_recordings(
            named_sources([str(tmp_path / "list.yaml")]), tmp_path / "out.yaml", beam=Beam()
        )
    assert not (tmp_path / "out.yaml").exists()


def test_a_list_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(
        UserError, match=r"cannot be read \(No such file or directory\); give a YAML"
    ):
        listed_sources(tmp_path / "list.yaml")
