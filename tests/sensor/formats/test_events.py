from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.sensor import Jitter, changed, expose_events, preset
from megalopta.sensor.formats.events import (
    EventOrigin,
    events_hdf5_writer,
    events_npz_writer,
    write_events_hdf5,
    write_events_npz,
)
from megalopta.sensor.formats.reading import read_events

SENSOR = changed(preset("ideal"), jitter=Jitter(sigma_s=1e-3))
RATE = np.random.default_rng(0).uniform(0, 1500, (6, 20, 30))
ORIGIN = EventOrigin(
    shape=RATE.shape, frame_period_s=0.125, exposure_s=SENSOR.exposure_s, extra={"µ": [1, None]},
    first_frame=2,
)  # fmt: skip
WRITERS = {
    "a.h5": (write_events_hdf5, events_hdf5_writer),
    "a.npz": (write_events_npz, events_npz_writer),
}


def draw(part=slice(None)):
    first = 2 + range(6)[part][0]
    return expose_events(RATE[part], SENSOR, seed=0, stream="s", first_frame=first)


@pytest.fixture(params=WRITERS)
def path(request, tmp_path):
    WRITERS[request.param][0](tmp_path / request.param, draw(), ORIGIN)
    return tmp_path / request.param


def test_events_come_back_to_a_picosecond(path):
    events, found = draw(), read_events(path)
    np.testing.assert_array_equal(found.events.pixel, events.pixel)
    np.testing.assert_array_equal(found.events.starts, events.starts)
    # half a picosecond, and the rounding of a product
    assert np.abs(found.events.time_s - events.time_s).max() < 0.501e-12
    assert found.origin == ORIGIN
    assert found.events.shape == RATE.shape
    assert found.events.first_frame == 2


def test_events_written_in_parts_are_the_same(path, tmp_path):
    with WRITERS[path.name][1](tmp_path / "parts", ORIGIN) as write:
        for part in (slice(0, 1), slice(1, 4), slice(4, 6)):
            write(draw(part))
    if path.suffix == ".npz":
        assert (tmp_path / "parts").read_bytes() == path.read_bytes()
    found = read_events(tmp_path / "parts").events
    np.testing.assert_array_equal(found.pixel, draw().pixel)
    assert {each.name for each in tmp_path.iterdir()} == {"parts", path.name}


def test_hdf5_has_the_names_of_event_cameras(tmp_path):
    events = draw()
    write_events_hdf5(tmp_path / "a.h5", events, ORIGIN)
    with h5py.File(tmp_path / "a.h5") as file:
        t, x, y, p = (file[f"events/{name}"][...] for name in "txyp")
        assert file["events/t"].attrs["unit"] == "ps"
        np.testing.assert_allclose(t, (events.frame * 0.125 + events.time_s) * 1e12, atol=1)
        np.testing.assert_array_equal(x, events.column)
        np.testing.assert_array_equal(y, events.row)
        assert p.size == t.size
        assert np.all(p == 1)
        assert file["events/p"].id.get_storage_size() == 0


def test_missing_or_other_frames_leave_no_file(path, tmp_path):
    other = replace(ORIGIN, shape=(6, 20, 31))
    for origin, message in ((ORIGIN, "1 frames were written of 6"), (other, "the file is for")):
        with (
            pytest.raises(ValueError, match=message),
            WRITERS[path.name][1](tmp_path / "parts", origin) as write,
        ):
            write(draw(slice(0, 1)))
    assert list(tmp_path.iterdir()) == [path]


def refused(path: Path, content: bytes) -> bool:
    path.write_bytes(content)
    try:
        read_events(path)
    except ValueError as problem:
        assert str(problem).startswith(str(path))
        assert "\n" not in str(problem)
        return True
    return False


def test_flipped_bits_of_data_are_noticed(path):
    whole = bytearray(path.read_bytes())
    for place in np.linspace(0.2, 0.8, 25) * len(whole):
        damaged = whole.copy()
        damaged[int(place)] ^= 0x10
        unused = whole[int(place) - 8 : int(place) + 8] == bytes(16)
        assert refused(path, damaged) or unused


def test_numbers_that_do_not_fit_are_refused(tmp_path):
    for name, index, value in (("x", 3, 30), ("y", 3, 20), ("t", 5, 2**62)):
        write_events_hdf5(tmp_path / "a.h5", draw(), ORIGIN)
        with h5py.File(tmp_path / "a.h5", "r+") as file:
            file[f"events/{name}"][index] = value
        with pytest.raises(ValueError, match=r"a\.h5 is missing or damaged"):
            read_events(tmp_path / "a.h5")


def test_array_that_claims_more_than_the_file_holds_is_not_read(tmp_path):
    write_events_hdf5(tmp_path / "a.h5", draw(), ORIGIN)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        for name in "txy":
            file[f"events/{name}"].resize((2**40,))
    with pytest.raises(UserError, match="takes 7.04e\\+04 GB of memory"):
        read_events(tmp_path / "a.h5")
