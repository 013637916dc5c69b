"""Readings of files, recordings and events as they are shown."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from megalopta import sensor as sensors
from megalopta.core.errors import UserError
from megalopta.report.readings import ShownReadings, Treatment, read_mask, readings_of
from megalopta.sensor.quantities import histogram

from ..recordings import write_recording

SHAPE = (12, 16)
FLUX = np.linspace(0.1, 2.0, 16)
"""Detections in a frame, by column"""


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    """Packed bits of a flux that grows from left to right; one pixel is stuck."""
    bits = np.random.default_rng(0).random((4000, *SHAPE)) < 1 - np.exp(-FLUX)
    bits[:, 5, 7] = True
    path = tmp_path_factory.mktemp("cube") / "cube.binary.npy"
    np.save(path, np.packbits(bits, axis=-1))
    return path


def save(path, values):
    np.save(path, values)
    return path


def test_long_sums_of_large_frames_are_made_a_few_at_a_time():
    asked = []

    def read(part):
        asked.append(part.stop - part.start)
        counts = np.arange(part.start, part.stop)[:, np.newaxis, np.newaxis]
        shape = (asked[-1], 2048, 2048)
        return np.broadcast_to(counts, shape), np.broadcast_to(counts == 4, shape)

    readings = ShownReadings((9, 2048, 2048), read).treated(Treatment(summed=5))
    values, full = readings.frame(3)
    assert (values == 3 + 4 + 5 + 6 + 7).all() and full.all()
    assert sum(asked) == 5 and max(asked) == 2  # 8 million readings


def test_flux_follows_from_the_share_of_binary_frames_without_detection(cube):
    values, full = readings_of(cube).treated(Treatment(4000, is_inverted=True)).frame(0)
    # −ln q of a share q of n frames scatters by √((1 − q)/(q n))
    scatter = np.sqrt(np.expm1(FLUX) / 4000)
    off = np.delete((values - FLUX) / scatter, 5, axis=0)
    assert abs(off).max() < 4.5 and abs(off.mean()) < 0.35
    assert np.argwhere(full).tolist() == [[5, 7]]
    assert values[5, 7] > values.max(initial=0, where=~full)


def test_a_bad_pixel_takes_the_mean_of_its_good_neighbors(cube, tmp_path):
    bad = np.zeros(SHAPE, bool)
    bad[5, 7:9] = True
    mask = read_mask(save(tmp_path / "bad.npy", bad))
    treated = readings_of(cube).treated(Treatment(4000, is_inverted=True, bad=mask))
    raw, _ = readings_of(cube).treated(Treatment(4000, is_inverted=True)).frame(0)
    values, full = treated.frame(0)
    near = [(raw[4, 7], 1), (raw[6, 7], 1), (raw[5, 6], 1)]
    near += [(raw[row, column], 0.5) for row in (4, 6) for column in (6, 8)]
    expected = np.average(*np.transpose(near)[[0]], weights=np.transpose(near)[1])
    assert values[5, 7] == pytest.approx(expected)
    assert not full.any()
    np.testing.assert_array_equal(values[~bad], raw[~bad])
    assert "2 bad pixels" in treated.treatment.description()


def test_of_a_recording_what_dead_time_lost_comes_back(tmp_path):
    """Of even light, whose last row was not read."""
    rate_hz, frames = 12_000.0, (300, 16, 16)
    dark = sensors.without(sensors.preset("spadcam"), "dark_counts")
    sensor = sensors.changed(dark, exposure_s=0.01, dead_time={"dead_time_s": 8e-6})
    counts = sensors.expose_rate(np.full(frames, rate_hz), sensor, seed=1, stream="flat").counts
    counter = sensor.counter
    leaked_v = counter.leak_v_s * sensor.exposure_s
    volts = counter.supply_v - leaked_v - counts * counter.step_v
    codes = np.rint(volts / counter.lsb_v).astype(np.uint16)
    codes[:, 15] = 65535
    folder = write_recording(tmp_path / "flat", sensor, codes, 0.02, 15)
    readings = readings_of(folder)
    np.testing.assert_allclose(readings.times_s[:2], [0, 0.02])
    raw, _ = readings.frame(0)
    values, full = readings.treated(Treatment(300, is_inverted=True)).frame(0)
    assert raw.mean() < 0.95 * 0.01 * rate_hz  # of 120 arrivals, counts lack some
    # 240 pixels and 300 frames: 0.04 %; pixels differ in what they read, by up to a percent
    assert values[:15].mean() == pytest.approx(0.01 * rate_hz, rel=0.02)
    assert full[15].all() and not full[:15].any()


def test_events_are_counted_in_every_frame(tmp_path):
    events = sensors.expose_events(
        np.full((5, 6, 8), 3e3), sensors.preset("ideal"), seed=0, stream="e"
    )
    origin = sensors.EventOrigin(shape=(5, 6, 8), frame_period_s=0.01, exposure_s=0.002)
    sensors.write_events_hdf5(tmp_path / "e.h5", events, origin)
    readings = readings_of(tmp_path / "e.h5")
    whole = histogram(events)
    assert whole.sum() > 500
    np.testing.assert_array_equal(readings.frame(3)[0], whole[3])
    np.testing.assert_array_equal(
        readings.treated(Treatment(summed=2)).frame(3)[0], whole[3:].sum(axis=0)
    )
    np.testing.assert_allclose(readings.times_s, 0.01 * np.arange(5))


@pytest.mark.parametrize(
    ("treatment", "said"),
    [
        (Treatment(summed=4001), "--sum 4001: there are 4000 frames"),
        (Treatment(is_inverted=True), "one binary frame does not determine the flux; add --sum"),
        (Treatment(bad=np.zeros((3, 4), bool)), "a mask of 4 × 3 pixels, but frames have 16 × 12"),
    ],
)
def test_what_cannot_be_done_to_frames_is_said(cube, treatment, said):
    with pytest.raises(UserError, match=said):
        readings_of(cube).treated(treatment)


def test_counts_of_an_unknown_sensor_cannot_be_inverted(tmp_path):
    counts = readings_of(save(tmp_path / "counts.npy", np.ones((3, *SHAPE), np.uint16)))
    with pytest.raises(UserError, match="the response of this sensor is not known"):
        counts.treated(Treatment(is_inverted=True))
    counter = replace(counts, sensor=sensors.preset("spadcam"))
    assert counter.treated(Treatment(is_inverted=True)).frame(0)[0] == pytest.approx(1, rel=0.1)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("none", None, "no dataset, recording, or file of frames or events; give one"),
        ("text", b"hello", "of no format that is known"),
        ("array", b"\x93NUMPYxxxx", "is missing or damaged"),
        ("my clip.mp4", b"anything", r"sense '.*my clip\.mp4' --photons 2"),
    ],
)
def test_what_holds_no_readings_is_told_in_a_sentence(tmp_path, name, content, said):
    if content:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=said):
        readings_of(tmp_path / name)


def test_a_folder_of_pictures_with_bits_is_shown(tmp_path):
    bits = (np.random.default_rng(0).random((30, *SHAPE)) < 0.3).astype(np.uint8)
    folder = tmp_path / "flat_10us"
    folder.mkdir()
    for number, frame in enumerate(bits):
        Image.fromarray(255 * frame).save(folder / f"{number}.png")
    shown = readings_of(folder)
    assert (shown.shape, shown.bits) == ((30, *SHAPE), 1)
    assert shown.times_s[-1] == pytest.approx(29e-5)
    np.testing.assert_array_equal(shown.read(slice(9, 12))[0], bits[9:12])


def test_gray_pictures_are_shown_where_somebody_states_that_they_are_counts(tmp_path):
    counts = np.random.default_rng(0).poisson(9, (3, *SHAPE)).astype(np.uint8)
    for number, frame in enumerate(counts):
        Image.fromarray(frame).save(tmp_path / f"{number}.png")
    with pytest.raises(UserError, match="make photons of them first: .*give --format png or tiff"):
        readings_of(tmp_path)
    np.testing.assert_array_equal(readings_of(tmp_path, "png").read(slice(None))[0], counts)
    (tmp_path / "recording.yaml").write_text("exposure_s: 1.0e-3\n")
    assert readings_of(tmp_path).times_s[2] == pytest.approx(2e-3)


@pytest.mark.parametrize("values", [np.zeros((3, 3)), np.ones((3, 3), bool), np.zeros(3, bool), 0])
def test_a_mask_is_of_bool_and_leaves_good_pixels(tmp_path, values):
    with pytest.raises(UserError, match=r"--bad-pixels: .*m\.npy is no mask"):
        read_mask(save(tmp_path / "m.npy", values))
