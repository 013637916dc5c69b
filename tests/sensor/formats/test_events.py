from dataclasses import replace

import h5py
import numpy as np
import pytest

from megalopta.sensor import Jitter, changed, expose_events, preset
from megalopta.sensor.formats.events import EventOrigin, events_hdf5_writer, read_events

SENSOR = changed(preset("ideal"), jitter=Jitter(sigma_s=1e-3))
RATE = np.random.default_rng(0).uniform(0, 1500, (6, 20, 30))
ORIGIN = EventOrigin(
    shape=RATE.shape, frame_period_s=0.125, exposure_s=SENSOR.exposure_s, extra={"µ": [1, None]},
    first_frame=2,
)  # fmt: skip


def draw(part=slice(None)):
    first = 2 + range(6)[part][0]
    return expose_events(RATE[part], SENSOR, seed=0, stream="s", first_frame=first)


@pytest.fixture
def path(tmp_path):
    with events_hdf5_writer(tmp_path / "a.h5", ORIGIN) as write:
        for part in (slice(0, 1), slice(1, 4), slice(4, 6)):
            write(draw(part))
    return tmp_path / "a.h5"


def test_events_come_back_to_a_picosecond(path):
    events, found = draw(), read_events(path)
    np.testing.assert_array_equal(found.events.pixel, events.pixel)
    np.testing.assert_array_equal(found.events.starts, events.starts)
    # half a picosecond, and the rounding of a product
    assert np.abs(found.events.time_s - events.time_s).max() < 0.501e-12
    assert found.origin == ORIGIN
    assert found.events.shape == RATE.shape
    assert found.events.first_frame == 2


def test_hdf5_has_the_names_of_event_cameras(path):
    events = draw()
    with h5py.File(path) as file:
        t, x, y, p = (file[f"events/{name}"][...] for name in "txyp")
        np.testing.assert_allclose(t, (events.frame * 0.125 + events.time_s) * 1e12, atol=1)
        np.testing.assert_array_equal([x, y], [events.column, events.row])
        assert p.size == t.size and np.all(p == 1)
        assert file["events/p"].id.get_storage_size() == 0


def test_missing_or_other_frames_leave_no_file(path, tmp_path):
    other = replace(ORIGIN, shape=(6, 20, 31))
    for origin, message in ((ORIGIN, "1 frames were written of 6"), (other, "the file is for")):
        with (
            pytest.raises(ValueError, match=message),
            events_hdf5_writer(tmp_path / "parts", origin) as write,
        ):
            write(draw(slice(0, 1)))
    assert list(tmp_path.iterdir()) == [path]


def test_flipped_bits_of_data_are_noticed(path):
    whole = bytearray(path.read_bytes())
    for place in np.linspace(0.2, 0.8, 25) * len(whole):
        damaged = whole.copy()
        damaged[int(place)] ^= 0x10
        path.write_bytes(damaged)
        try:
            read_events(path)
        except ValueError as problem:
            assert str(problem).startswith(str(path)) and "\n" not in str(problem)
        else:
            assert whole[int(place) - 8 : int(place) + 8] == bytes(16)  # unused


@pytest.mark.parametrize(
    ("name", "index", "value"), [("x", 3, 30), ("y", 3, 20), ("t", 5, 2**62), ("p", 0, None)]
)
def test_numbers_that_do_not_fit_are_refused(path, name, index, value):
    with h5py.File(path, "r+") as file:
        if value is None:  # an array that claims more than the file holds
            file["events/t"].resize((2**40,))
        else:
            file[f"events/{name}"][index] = value
    message = r"a\.h5 is missing or damaged" if value else "takes 7.04e\\+04 GB of memory"
    with pytest.raises(ValueError, match=message):
        read_events(path)
