"""Time tags of files that other programs, or a page of their layout, make."""

import struct
from pathlib import Path

import h5py
import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.sensor.calibrate.time_tags import events_of
from megalopta.sensor.formats.time_tags import read_linospad2, read_time_tags

UNIT_S = 12.5e-9
TICKS = np.array([3, 8, 8, 20, 41, 90_000_000])
CHANNELS = np.array([0, 1, 0, 2, 1, 2])


def photon_hdf5(path, groups, **stated):
    """Photon-HDF5, as its reference describes it; with further values, __ for /."""
    with h5py.File(path, "w") as file:
        for name, value in stated.items():
            file[name.replace("__", "/")] = value
        for name, ticks, detectors in groups:
            file[f"{name}/timestamps"] = ticks
            file[f"{name}/timestamps_specs/timestamps_unit"] = UNIT_S
            if detectors is not None:
                file[f"{name}/detectors"] = detectors.astype(np.uint8)


def ptu_of_mode_t2(path, ticks, channels, inputs, stopped_ms):
    """PTU of a HydraHarp in mode T2, as PicoQuant's page of the layout describes it."""

    def tag(name, kind, value):
        return name.encode().ljust(32, b"\0") + struct.pack("<iI", -1, kind) + value

    def integer(name, value):
        return tag(name, 0x10000008, struct.pack("<q", value))

    records, over = [], 0
    for tick, channel in zip(ticks.tolist(), channels.tolist(), strict=True):
        wraps, rest = divmod(tick, 2**25)
        if wraps > over:  # the record counts overflows of 25 bits
            records.append(0xFE000000 | (wraps - over))
            over = wraps
        records.append(channel << 25 | rest)  # no special bit
    content = b"PQTTTR\0\0" + b"1.0.00\0\0".ljust(8, b"\0")
    content += integer("Measurement_Mode", 2) + integer("Measurement_SubMode", 0)
    content += integer("TTResultFormat_TTTRRecType", 0x01010204)
    content += integer("TTResult_NumberOfRecords", len(records))
    content += integer("TTResultFormat_BitsPerRecord", 32)
    content += tag("MeasDesc_GlobalResolution", 0x20000008, struct.pack("<d", UNIT_S))
    content += integer("HW_InpChannels", inputs) + integer("TTResult_StopAfter", stopped_ms)
    content += tag("Header_End", 0xFFFF0008, bytes(8))
    path.write_bytes(content + np.array(records, "<u4").tobytes())


def test_detectors_of_several_spots_are_channels_in_order(tmp_path):
    path = tmp_path / "dark.hdf5"
    photon_hdf5(path, [(f"photon_data{at}", TICKS + at, CHANNELS) for at in (0, 10, 2)])
    tags = read_time_tags(path)
    assert tags.channels == 9
    for channel in range(9):
        spot = (0, 2, 10)[channel // 3]
        own = (TICKS + spot)[channel % 3 == CHANNELS] * UNIT_S
        np.testing.assert_allclose(tags.time_s[tags.channel == channel], own, rtol=1e-15)


def test_ptu_of_mode_t2_has_absolute_times_and_states_inputs_and_duration(tmp_path):
    pytest.importorskip("ptufile")
    ptu_of_mode_t2(tmp_path / "dark.ptu", TICKS, CHANNELS, inputs=8, stopped_ms=1500)
    tags = read_time_tags(tmp_path / "dark.ptu")
    assert (tags.channels, tags.duration_s) == (8, 1.5)
    np.testing.assert_allclose(tags.time_s, TICKS * UNIT_S, rtol=1e-12)
    np.testing.assert_array_equal(tags.channel, CHANNELS)


def test_ptu_of_mode_t3_that_ptufile_writes(tmp_path):
    ptufile = pytest.importorskip("ptufile")
    histogram = np.zeros((1, 4, 5, 2, 16), np.uint8)  # frames, rows, columns, channels, bins
    histogram[0, :, :, 0, 3], histogram[0, 1, 2, 1, 7] = 1, 2
    path = tmp_path / "image.ptu"
    ptufile.imwrite(path, histogram, 50e-9, 1e-9, pixel_time=1e-6)
    tags = read_time_tags(path)
    assert np.bincount(tags.channel).tolist() == [20, 2]
    delays = np.rint(tags.time_s % 50e-9 / 1e-9)
    assert set(delays[tags.channel == 0]) == {3}
    assert set(delays[tags.channel == 1]) == {7}


def linospad2(path, cycles):
    """Write cycles of (absolute ticks, [(converter, slot in it, pixel of four, code)])."""
    words = []
    for ticks, events in cycles:
        stamps = np.zeros((65, 8), "<u4")
        for converter, slot, pixel, code in events:
            stamps[converter, slot] = 1 << 31 | pixel << 28 | code
        stamps[64] = 1 << 31 | 99  # the last converter has no pixels
        words += [np.array([ticks & 0xFFFFFFFF, ticks >> 32], "<u4"), stamps.ravel()]
    np.concatenate(words).tofile(path)


@pytest.mark.parametrize(
    ("firmware", "channels"), [("2212b", [11, 2, 255]), ("2212s", [194, 128, 255])]
)
def test_linospad2_has_times_and_pixels_of_every_cycle(tmp_path, firmware, channels):
    first, later = 2**33 + 5, 2**33 + 5 + 10**6
    path = tmp_path / "dark.dat"
    linospad2(path, [(first, [(2, 0, 3, 140), (63, 7, 3, 2**28 - 1)]), (later, [(0, 1, 2, 0)])])
    tags = read_linospad2(path, firmware, 8)
    expected = [2.5e-9, (2**28 - 1) * 2.5e-9 / 140, 7.5e-3]
    order = [0, 2, 1]
    np.testing.assert_allclose(tags.time_s, np.array(expected), rtol=1e-12)
    np.testing.assert_array_equal(tags.channel, np.array(channels)[order])
    assert tags.channels == 256


def test_linospad2_of_another_cycle_is_refused(tmp_path):
    linospad2(tmp_path / "dark.dat", [(1, [(2, 0, 3, 140)])])
    with pytest.raises(ValueError, match=r"522 words are not cycles of 33282, of 512 time stamps"):
        read_linospad2(tmp_path / "dark.dat", "2212b")


@pytest.mark.parametrize("content", [b"", b"anything else", b"\x89HDF\r\n\x1a\n" + bytes(99)])
def test_other_files_are_refused_in_a_sentence(tmp_path, content):
    (tmp_path / "file").write_bytes(content)
    with pytest.raises(
        ValueError, match=r"file(: no time tags|: the file is empty| is missing or damaged)"
    ):
        read_time_tags(tmp_path / "file")


def test_times_in_another_file_are_not_followed(tmp_path):
    photon_hdf5(tmp_path / "secret.hdf5", [("photon_data", TICKS, None)])
    with h5py.File(tmp_path / "link.hdf5", "w") as file:
        file["photon_data/timestamps_specs/timestamps_unit"] = UNIT_S
        file["photon_data/timestamps"] = h5py.ExternalLink("secret.hdf5", "photon_data/timestamps")
    with pytest.raises(ValueError, match="timestamps is missing, or a link"):
        read_time_tags(tmp_path / "link.hdf5")


@pytest.mark.parametrize(
    ("stated", "channels"),
    [
        ({"setup__num_pixels": 6}, 6),
        ({"setup__detectors__id": np.arange(5, dtype="u1")}, 5),
        ({"acquisition_duration": 7.5}, 3),
    ],
)
def test_pixels_and_duration_are_those_that_photon_hdf5_states(tmp_path, stated, channels):
    photon_hdf5(tmp_path / "dark.hdf5", [("photon_data", TICKS, CHANNELS)], **stated)
    tags = read_time_tags(tmp_path / "dark.hdf5")
    assert tags.channels == channels
    np.testing.assert_array_equal(tags.channel, CHANNELS)
    expected = stated.get("acquisition_duration", (TICKS[-1] - TICKS[0]) * UNIT_S)
    assert tags.duration_s == pytest.approx(expected)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"setup__num_pixels": 2}, "channel 2 of 2"),
        ({"setup__num_pixels": 10**9}, "1,000,000,000 channels"),
        ({"setup__detectors__id": np.array([0, 1], "u1")}, "not in setup/detectors/id"),
        ({"acquisition_duration": 0.5}, "duration of 0.5 s, but its events last 1.12"),
        ({"acquisition_duration": np.nan}, "duration of nan s"),
    ],
)
def test_what_photon_hdf5_states_must_fit_its_events(tmp_path, stated, said):
    photon_hdf5(tmp_path / "dark.hdf5", [("photon_data", TICKS, CHANNELS)], **stated)
    with pytest.raises(UserError, match=said):
        read_time_tags(tmp_path / "dark.hdf5")


def test_few_bytes_that_claim_many_events_are_refused(tmp_path):
    photon_hdf5(tmp_path / "a.hdf5", [("photon_data", TICKS, None)])
    with h5py.File(tmp_path / "a.hdf5", "r+") as file:
        del file["photon_data/timestamps"]
        file.create_dataset("photon_data/timestamps", (5 * 10**8,), "i8", chunks=(2**20,))
    with pytest.raises(UserError, match=r"takes 32 GB of memory"):
        read_time_tags(tmp_path / "a.hdf5")


def spc(path, ticks, channels, routing_bits=4, clock=95, others=()):
    """FIFO file of an SPC-150, as the handbook's table has it; other records at the end."""
    words, overflows = [1 << 31 | routing_bits << 27 | clock], 0
    for tick, channel in zip(ticks.tolist(), channels.tolist(), strict=True):
        wraps, rest = divmod(tick, 4096)
        flag = 0
        if wraps - overflows > 1:
            words.append(0xC0000000 | (wraps - overflows))
        elif wraps > overflows:
            flag = 1 << 30
        overflows = wraps
        words.append(flag | 2000 << 16 | channel << 12 | rest)
    path.write_bytes(np.array([*words, *others], "<u4").tobytes())


def test_spc_counts_overflows_of_the_macro_time(tmp_path):
    invalid, mark = 0x80000000 | 5, 0x90000000 | 3 << 12 | 7
    ticks = np.array([3, 8, 8, 20, 4095, 4097, 4098, 90_000_000])
    channels = np.array([0, 1, 0, 2, 1, 2, 15, 3])
    spc(tmp_path / "a.spc", ticks, channels, others=[invalid, mark, 0, 0])
    tags = read_time_tags(tmp_path / "a.spc")
    np.testing.assert_allclose(tags.time_s, ticks * 9.5e-9)
    np.testing.assert_array_equal(tags.channel[tags.time_s > 1e-6], [2, *channels[4:]][1:])
    assert (tags.channels, tags.unit_s) == (16, pytest.approx(9.5e-9))


@pytest.mark.parametrize(
    "content", [b"", b"abc", bytes(400), b"\x5f\0\0\x04" + bytes(range(80)), b"\x5f\0\0\0" * 9]
)
def test_damaged_spc_is_one_sentence(tmp_path, content):
    (tmp_path / "a.spc").write_bytes(content)
    with pytest.raises(UserError if content else ValueError, match=r"a\.spc"):
        read_time_tags(tmp_path / "a.spc")


def test_events_of_a_public_file_are_those_that_its_own_reader_finds():
    tags = read_time_tags(Path(__file__).parents[3] / "docs/public_arrays/spc-150/noise.spc")
    # `test_noise.asc` of phconvert: 6114 lines, the last at 1,700,018,969 clocks of 9.5 ns
    assert events_of(tags).tolist() == [6114]
    assert tags.duration_s == pytest.approx(
        1_700_018_969 * 9.5e-9, abs=1e-3
    )  # from the first event
