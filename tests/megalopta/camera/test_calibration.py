"""Recordings and tables to a device file and a page, through the command line's door."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from megalopta.camera.calibration import (
    calibrate_recordings,
    calibration_of,
    primary,
    write_array_device,
    write_device,
)
from megalopta.camera.measurements import read_measurement
from megalopta.camera.sources import Beam, Source, named_sources, read_recorded
from megalopta.cli.main import main
from megalopta.core.errors import UserError
from megalopta.sensor import changed, expose_rate, load_sensor, preset, reading_moments
from megalopta.sensor.calibrate.crosstalk import Kernel
from megalopta.sensor.calibrate.device import calibrate_device
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.calibrate.pixels import Estimate, correlation
from megalopta.sensor.calibrate.statistics import statistics
from megalopta.sensor.effects.crosstalk import neighborhoods
from megalopta.sensor.formats.recorded_frames import tiff_writer
from megalopta.sensor.spad.device import draw_fixed_pattern

from ..recordings import write_recording

SHAPE = (12, 16)
DARK_HZ, EFFICIENCY = 400.0, 0.3


def lines(*entries):
    """A list of recordings."""
    return "recordings:\n" + "".join(f"  - {{{each}}}\n" for each in entries)


def written(folder, name, mean, capacity=None):
    """Poisson counts in a file."""
    rng = np.random.default_rng(len(name))
    counts = np.clip(rng.poisson(mean * np.ones((400, *SHAPE))), None, capacity).astype(np.uint16)
    with tiff_writer(folder / f"{name}.tif", counts.nbytes, 1.0) as write:
        write(counts)


def exposed(folder, sensor, frames, shape, light):
    """Dark frames and lit ones, written as a sensor counts them."""
    for name, hz in (("dark", 0.0), ("flat", light)):
        rate = np.full((frames, *shape), EFFICIENCY * hz)
        counts = expose_rate(rate, sensor, seed=1, stream=name).counts
        np.save(folder / f"{name}.npy", counts.astype(np.uint16))


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
    assert "medians of 192 pixels" in sentence and "0 pixels are bad, 0 hot" in sentence
    assert "has those of ideal: dead time: needs counts under two lights" in sentence
    counts = expose_rate(np.zeros((300, *SHAPE)), device, seed=1, stream="dark").counts
    # 2.3 million dark counts of a device calibrated with 0.6 million, 0.15 %: six errors
    assert counts.mean() / device.exposure_s == pytest.approx(DARK_HZ, rel=0.009)
    assert "± 95 % CI of efficiency (%)" in page and "variance of readings" in page
    assert np.load(tmp_path / "device" / "bad.npy").sum() == 0


@pytest.mark.slow
def test_a_base_file_and_lights_that_cannot_be_as_stated(tmp_path, capsys):
    for name, mean in (("dark", DARK_HZ * 0.02), ("flat", DARK_HZ * 1e-3 + EFFICIENCY * 20)):
        written(tmp_path, name, mean)
    base = tmp_path / "base.yaml"
    base.write_text("preset: ideal\nfill_factor: 0.5\npitch_m: 2.0e-5\ncounter: {capacity: 4095}\n")
    for light in (2e4, 20.0):  # the second one of an exposure
        flat = f"path: flat.tif, exposure_s: 0.001, light: {light:.1e}"
        (tmp_path / "list.yaml").write_text(lines("path: dark.tif, exposure_s: 0.02", flat))
        words, out = (
            ["spadcam", "calibrate", str(tmp_path / "list.yaml")],
            tmp_path / f"{light}.yaml",
        )
        words += ["--wavelength-nm", "600", "--preset", str(base), "--out", str(out)]
        if light < 1e3:
            with pytest.raises(SystemExit):
                main(words)
            assert "more counts than photons; check LIGHT" in capsys.readouterr().err
            assert not out.exists()
            continue
        main(words)
        device = load_sensor(out)
        assert (device.pitch_m, device.counter.capacity) == (2e-5, 4095)
        pde = np.median(draw_fixed_pattern(device, SHAPE).efficiency_factor)
        pde *= device.photon_detection_efficiency(np.array(600.0))
        assert pde == pytest.approx(EFFICIENCY, rel=0.009)  # as above
        assert "; dead time of " in device.source


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
    exposed(tmp_path, true, 400, shape, 5e4)
    found, _, page = calibrated(
        tmp_path,
        "path: dark.npy, exposure_s: 0.001",
        "path: flat.npy, exposure_s: 0.001, light: 5.0e+4",
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
    assert "neighbors of hot pixels" in page


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
        correlation(statistics(each), np.ones((24, 24), bool)).is_telegraph
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


def test_a_folder_of_sums_is_calibrated_compared_and_recognized(tmp_path, capsys):
    rng, folder, out = np.random.default_rng(4), tmp_path / "rec", tmp_path / "camera.yaml"
    folder.mkdir()
    for name, mean in (("dark", 0.004), ("flat_1e5", 0.104), ("flat_1e6", 1.004)):
        sums = rng.binomial(255, -np.expm1(-mean), (200, *SHAPE))
        np.save(folder / f"{name}.npy", sums.astype(np.uint16))
    whole, one = "exposure_s: 1.02e-3", "exposure_s: 4.0e-6\nsums: 255"
    for stated in (whole, one):  # 4 µs each
        (folder / "recording.yaml").write_text(stated, "utf-8")
        main(["spadcam", "calibrate", str(folder), "--wavelength-nm", "600", "--out", str(out)])
        hint = "as sums of about 255 binary frames" in capsys.readouterr().err
        assert hint == (stated is whole)
    device = load_sensor(out)
    assert (device.counter.capacity, device.counter.sums) == (1, 255)
    assert device.exposure_s == pytest.approx(1.02e-3)
    page = ["--wavelength-nm", "600", "--out", str(tmp_path / "compared.html")]
    main(["spadcam", "compare", str(folder), "--device", str(out), *page])
    assert "agree" in capsys.readouterr().out
    with pytest.raises(UserError, match="its maps would lie among recordings"):
        calibrate_recordings(named_sources([str(folder)]), tmp_path / "rec.yaml", beam=Beam(600.0))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("dark.npy:1e-2", r"'dark\.npy:1e-2': give RECORDING@LIGHT:SECONDS"),
        ("flat@bright", "give RECORDING@LIGHT:SECONDS"),
        ("flat@-1", "light"),
        ("flat@1:0", "exposure_s"),
        ("nothing.yaml", r"cannot be read \(No such file or directory\); give a YAML"),
        (["path: dark.tif, exposure_s: 0"], "exposure_s"),
        (["path: dark.tif, lens: 2"], "lens"),
        (
            ["path: flat.npy, exposure_s: 1e-3, light: 1e6"],
            "5000: the device's .* from 200 to 2000 nm",
        ),
        (["path: flat.npy, light: 1e6"], "exposure is unknown"),
        (["path: flat.npy, exposure_s: 1e-3, frames: [10, 99]"], "it has 60"),
    ],
)
def test_recordings_that_cannot_be_calibrated_are_refused(words, told, tmp_path):
    np.save(tmp_path / "flat.npy", np.ones((60, 4, 4), np.uint16))
    if isinstance(words, list):
        (tmp_path / "list.yaml").write_text(lines(*words), "utf-8")
        words = str(tmp_path / "list.yaml")
    with pytest.raises(UserError, match=told):
        calibrate_recordings(
            named_sources([words]), tmp_path / "x.yaml", beam=Beam(5000.0), base="ideal"
        )


SIDES = (16, 16)
DARK_EXPOSURES_S = (1e-3, 3e-3, 0.01, 0.03, 0.1)
LIGHTS_HZ = (2e8, 1e9, 4e9)
SPADCAM = changed(preset("spadcam"), device_seed=9)
OF_SPADCAM = 1.1e-4
"""Of the photons on a pixel at 700 nm: 0.11 % on a tenth of its area."""


def recorded(folder, exposure_s, light_hz, frames=100, seed=0):
    """A recording of codes that counts and read noise make."""
    sensor = changed(SPADCAM, exposure_s=exposure_s)
    pattern, counter = draw_fixed_pattern(sensor, SIDES), sensor.counter
    rates = np.broadcast_to(light_hz * OF_SPADCAM * pattern.efficiency_factor, (frames, *SIDES))
    counts = expose_rate(rates, sensor, seed=seed, stream=folder.name).counts
    volts = counter.supply_v - counts * pattern.counters.step_v - pattern.counters.leaked_v
    noise = np.random.default_rng(seed + round(1e6 * exposure_s)).normal(0, 1e-3, volts.shape)
    codes = np.rint((volts + noise) / counter.lsb_v).clip(0, 4095).astype(np.uint16)
    return Source(path=write_recording(folder, sensor, codes), light=light_hz)


@pytest.fixture(scope="module")
def spadcam(tmp_path_factory):
    """Folder of recordings and the device file from them."""
    folder = tmp_path_factory.mktemp("camera")
    levels = [(exposure, 0.0) for exposure in DARK_EXPOSURES_S]
    levels += [(2e-4, light) for light in LIGHTS_HZ]
    sources = [recorded(folder / f"{at}", *each) for at, each in enumerate(levels)]
    sentence = calibrate_recordings(sources, folder / "device.yaml", beam=Beam(700.0))
    return folder, sources, sentence


@pytest.mark.slow
def test_the_device_file_loads_with_its_maps(spadcam):
    folder, _, sentence = spadcam
    device = load_sensor(folder / "device.yaml")
    found, truth = (draw_fixed_pattern(each, SIDES) for each in (device, SPADCAM))
    # a pixel's dark counts are known to 1 to 2 %, its efficiency to 1.5 %, its step to 0.02 %
    np.testing.assert_allclose(found.dark_counts_hz, truth.dark_counts_hz, rtol=0.15)
    np.testing.assert_allclose(found.efficiency_factor, truth.efficiency_factor, rtol=0.1)
    np.testing.assert_allclose(found.counters.step_v, truth.counters.step_v, rtol=2e-3)
    assert device.dead_time.kind == "paralyzable"
    assert "medians of 256 pixels" in sentence and "0 pixels are bad" in sentence
    page = (folder / "device.html").read_text("utf-8")
    assert "Saturation" in page
    assert "absolute sensitivity threshold" in page


@pytest.mark.slow
def test_crosstalk_and_afterpulses_of_the_device_file_make_what_was_counted(spadcam, tmp_path):
    _, sources, _ = spadcam
    levels = [Level(read_recorded(s).codes, read_recorded(s).exposure_s, s.light) for s in sources]
    device = calibrate_device(levels, SPADCAM.counter)
    share = np.array([0.01, 0.01, 2e-3, 2e-3, 0, 0])
    by_parity = np.tile(share[:, None, None], (2, 2))
    kernel = Kernel(by_parity, np.full((6, 2, 2), 1e-4), afterpulses=0.05, afterpulses_error=1e-3)
    path = tmp_path / "fired.yaml"
    fired = calibration_of(replace(device, kernel=kernel), preset("spadcam"), 700.0)
    write_device(path, fired, "spadcam")
    found = changed(load_sensor(path), exposure_s=0.05)
    assert found.crosstalk.mean_fired_neighbors == pytest.approx(2 * share.sum())
    assert found.crosstalk.diagonal == pytest.approx(0.2)
    counts = expose_rate(np.zeros((150, *SIDES)), found, seed=1, stream="dark").counts
    # 150 000 events, of a variance a quarter above Poisson's: 5 standard errors are 1.5 %; dead
    # time hides 0.03 %, and of afterpulses, a second time, below 0.1 %
    expected = device.dark_counts_hz.value.mean()
    assert counts.mean() / 0.05 == pytest.approx(expected, rel=0.016)


def test_light_of_a_beam():
    # dissertation §2.4.5: 17.5 nW over 100 mm² at 450 nm are 396 photons per µm² and second
    pixel = changed(preset("spadcam"), pitch_m=1e-6)
    assert Beam(450, 100).photons_hz(17.5e-9, pixel) == pytest.approx(396, rel=2e-3)


def test_intervals_include_the_error_of_what_crosstalk_adds():
    dark = np.full(SIDES, 300.0)
    share = np.tile(np.array([0.01, 0.01, 0, 0, 0, 0])[:, None, None], (2, 2))
    kernel = Kernel(share, np.full((6, 2, 2), 1e-3), np.nan, np.nan)
    found = primary(Estimate(dark, dark, dark), kernel)
    # of 4 neighbors at 1 % each; means of eight edge, corner and second ones have errors of
    # 0.1 %/√8, and count four times each: the total has one of √6·0.1 % of an event
    half = 1.959964 * (dark - found.value) * np.sqrt(6) * 1e-3 / 0.04
    np.testing.assert_allclose(found.high - found.value, half)
    np.testing.assert_allclose(found.value - found.low, half)


ARRAYS = Path(__file__).parents[3] / "docs/public_arrays"
KINDS = "dark-counts", "crosstalk", "autocorrelation"


@pytest.mark.parametrize("number", [1, 2])
def test_the_command_writes_the_files_that_ship(number, tmp_path):
    out = tmp_path / f"array-{number}.yaml"
    tables = [str(ARRAYS / f"{kind}-{number}.csv") for kind in KINDS]
    main(["spadcam", "calibrate", *tables, "--preset", "ideal", "--out", str(out)])
    shipped = ARRAYS / out.name
    assert out.read_text("utf-8") == shipped.read_text("utf-8")
    np.testing.assert_allclose(
        np.load(tmp_path / out.stem / "dark_counts.npy"),
        np.load(ARRAYS / out.stem / "dark_counts.npy"),
    )


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ((KINDS[0], KINDS[0]), "2 tables of one kind"),
        ((KINDS[1],), "no map of dark counts"),
        (("1,-2\n3,4",), "rates are negative"),
        (("pix1,pix2,distance,crosstalk,error\n0,1,1,1e-3,1e-5",), "1 pairs"),
        (("events,duration_s,1-2\n0,1,3",), "1 pixels with events"),
    ],
)
def test_tables_that_do_not_suffice_are_refused(tmp_path, tables, message):
    paths = [ARRAYS / f"{table}-1.csv" for table in tables]
    if tables[0] not in KINDS:
        paths = [tmp_path / "other.csv"]
        paths[0].write_text(tables[0])
    with pytest.raises(ValueError, match=message):
        write_array_device(
            tmp_path / "a.yaml", [read_measurement(path) for path in paths], "ideal", ""
        )
    assert not (tmp_path / "a.yaml").exists()
