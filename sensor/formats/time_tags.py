"""Readers of time tags: `.ptu` (PicoQuant), `.spc` (Becker & Hickl), Photon-HDF5, and LinoSPAD2's.

Layouts: `docs/reference/recorded-files.md`.
"""

from pathlib import Path
from typing import Literal, NamedTuple

import h5py
import numpy as np

from megalopta.core import bounded
from megalopta.core.arrays import Floats, Ints
from megalopta.core.errors import DamagedFileError
from megalopta.core.progress import say
from megalopta.sensor.formats.events import HDF5_SIGNATURE
from megalopta.sensor.formats.recorded_frames import file_bytes

_CONVERTERS, _PIXELS_EACH = 64, 4
_CODE_S, _CLOCK_S = 2.5e-9 / 140, 7.5e-9
"""Steps of LinoSPAD2's converters, on average, and of its clock, s"""
_DECODED_BYTES = 64
"""Bytes in memory of an event, while it is read and sorted"""


class TimeTags(NamedTuple):
    """Events of a free-running array, sorted by time."""

    time_s: Floats
    """(N,)"""
    channel: Ints
    """Pixel of each event, (N,)"""
    channels: int
    """Pixels of the array, also those without events, if the file states them"""
    duration_s: float
    """As the file states it; otherwise from the first event to the last"""
    unit_s: float = 0.0
    """Step of the times; 0: continuous"""


def read_time_tags(path: str | Path) -> TimeTags:
    """Read a `.ptu`, Photon-HDF5 or `.spc` file.

    Raises FileNotFoundError if the path does not exist; ValueError if the file is of another format
    or damaged; ModuleNotFoundError if a `.ptu` file needs `ptufile`, which is not installed.
    """
    path = Path(path)
    beginning = file_bytes(path)[:8].tobytes()
    if beginning == b"PQTTTR\0\0":
        read = _ptu
    elif beginning == HDF5_SIGNATURE:
        read = _photon_hdf5
    elif path.suffix.lower() == ".spc":  # without a signature
        read = _spc
    else:
        raise DamagedFileError(f"{path}: no time tags; give a .ptu, .spc or Photon-HDF5 file")
    with bounded.undamaged(path):
        return _sorted(path, read(path))


def read_linospad2(
    path: str | Path, firmware: Literal["2212b", "2212s"], per_cycle: int = 512
) -> TimeTags:
    """Read a `.dat` file of half a LinoSPAD2, with the times of its cycles.

    Raises ValueError if the file's size is not that of such cycles.

    Parameters
    ----------
    firmware : str
        2212b: a converter has four neighboring pixels; 2212s: every 64th.
    per_cycle : int
        Time stamps of a converter in an acquisition cycle.
    """
    path = Path(path)
    content = file_bytes(path)
    cycle = (_CONVERTERS + 1) * per_cycle + 2
    if content.size % (4 * cycle):
        raise DamagedFileError(
            f"{path}: {content.size / 4:g} words are not cycles of {cycle}, of {per_cycle} time "
            "stamps each and an absolute time; state the recording's time stamps per cycle, or "
            "record with them"
        )
    bounded.check_decoded(path, (content.size // 4,), _DECODED_BYTES)
    words = content.view("<u4").reshape(-1, cycle)
    clock = words[:, 0] + (words[:, 1].astype(np.int64) << 32)
    start_s = _CLOCK_S * (clock - clock.min())
    stamps = words[:, 2:].reshape(-1, _CONVERTERS + 1, per_cycle)[:, :_CONVERTERS]
    number, converter, slot = np.nonzero(stamps >> 31)
    stamp = stamps[number, converter, slot].astype(np.int64)
    pixel = stamp >> 28 & 3
    block = firmware == "2212b"
    place = converter * _PIXELS_EACH + pixel if block else converter + _CONVERTERS * pixel
    time_s = start_s[number] + _CODE_S * (stamp & 0xFFFFFFF)
    return _sorted(path, TimeTags(time_s, place, _CONVERTERS * _PIXELS_EACH, 0.0, _CODE_S))


def _sorted(path: Path, tags: TimeTags) -> TimeTags:
    """Return events in the order of time; a duration of 0 is that from the first to the last."""
    if tags.time_s.size < 2:
        raise DamagedFileError(f"{path}: {tags.time_s.size} events; give a file with more")
    bounded.check_count(path, "channels", tags.channels, 4096)  # of which every pair has a number
    order = np.argsort(tags.time_s, kind="stable")
    time_s, channel = tags.time_s[order], tags.channel[order]
    if channel.min() < 0 or channel.max() >= tags.channels:
        raise DamagedFileError(f"{path}: an event of channel {channel.max()} of {tags.channels}")
    from_first_s = float(time_s[-1] - time_s[0])
    duration_s = tags.duration_s or from_first_s
    if not from_first_s * 0.999 - 1e-3 <= duration_s < np.inf:  # a .ptu file states milliseconds
        raise DamagedFileError(
            f"{path}: states a duration of {duration_s:g} s, but its events last "
            f"{from_first_s:g} s; correct one of them"
        )
    return tags._replace(time_s=time_s, channel=channel, duration_s=duration_s)


def _ptu(path: Path) -> TimeTags:
    import io

    import ptufile

    with ptufile.PtuFile(io.BytesIO(bounded.read_bytes(path, bounded.ARRAY_BYTES))) as file:
        bounded.check_decoded(path, (file.number_records,), _DECODED_BYTES)
        records = file.decode_records()
        records = records[records["channel"] >= 0]
        unit_s = file.global_resolution
        time_s = records["time"] * unit_s
        if file.is_t3:
            unit_s = file.tcspc_resolution
            time_s = time_s + records["dtime"] * unit_s
        inputs = int(file.tags.get("HW_InpChannels", 0))
        duration_s = 1e-3 * file.tags.get("TTResult_StopAfter", 0)
    channel = records["channel"].astype(np.int64)
    channels = max(inputs, int(channel.max(initial=-1)) + 1)  # T2 may number from 1
    return TimeTags(np.asarray(time_s, np.float64), channel, channels, duration_s, unit_s)


_SPC_INVALID, _SPC_OVERFLOW, _SPC_GAP, _SPC_MARK = (1 << bit for bit in (31, 30, 29, 28))


def _spc(path: Path) -> TimeTags:
    """Read records of 32 bits of the SPC-130, 140, 150 and 830 in FIFO mode: macro times alone.

    Micro times need the range of the converter, which only the `.set` file states.
    """
    content = file_bytes(path)
    if content.size % 4:
        raise ValueError(f"{content.size} bytes are no records of 32 bits")
    bounded.check_decoded(path, (content.size // 4,), _DECODED_BYTES)
    words = content.view("<u4")
    head = words[0]
    unit_s, inputs = 1e-10 * float(head & 0xFFFFFF), int(head >> 27 & 15)
    if not (head & _SPC_INVALID and unit_s) or head >> 26 & 1:
        raise ValueError("its first record is no header of 32-bit photons; save it in FIFO mode")
    records = np.trim_zeros(words[1:], "b")  # padded
    if (records & _SPC_GAP).any():
        say(f"{path}: photons were lost where the FIFO was full; rates are too low there")
    is_invalid, is_mark = (records & flag > 0 for flag in (_SPC_INVALID, _SPC_MARK))
    overflows = (records & _SPC_OVERFLOW > 0).astype(np.int64)
    are_many = (overflows > 0) & is_invalid & ~is_mark
    overflows[are_many] = records[are_many] & 0xFFFFFFF
    ticks = 4096 * np.cumsum(overflows) + (records & 0xFFF)
    is_photon = ~is_invalid & ~is_mark
    channel = (records[is_photon] >> 12 & 15).astype(np.int64)
    channels = max(1 << inputs if inputs <= 4 else 0, int(channel.max(initial=0)) + 1)
    return TimeTags(unit_s * ticks[is_photon], channel, channels, 0.0, unit_s)


def _photon_hdf5(path: Path) -> TimeTags:
    times, detectors, unit_s = [], [], 0.0
    with bounded.opened_hdf5(path) as file:
        spots = [name for name in file if name.startswith("photon_data")]
        if not spots:
            raise ValueError("no photon_data")
        spots.sort(key=lambda name: int(name.removeprefix("photon_data") or 0))
        stamps = [
            bounded.dataset_in(file, f"{spot}/timestamps", "iu", 1, _DECODED_BYTES)
            for spot in spots
        ]
        bounded.check_decoded(path, (sum(ticks.size for ticks in stamps),), _DECODED_BYTES)
        for spot, ticks in zip(spots, stamps, strict=True):
            unit_s = _number_in(file, f"{spot}/timestamps_specs/timestamps_unit", 0.0)
            detector = np.zeros(ticks.size, np.int64)
            if bounded.is_in(file, f"{spot}/detectors"):
                detector = bounded.numbers_in(file, f"{spot}/detectors", "iu", 1).astype(np.int64)
            if detector.size != ticks.size or not 0 < unit_s < 1:
                raise ValueError(
                    f"{detector.size} detectors of {ticks.size} times, unit of {unit_s} s"
                )
            times.append(ticks[()] * unit_s)
            detectors.append(detector)
        channel, channels = _channels(file, detectors)
        duration_s = _number_in(file, "acquisition_duration", 0.0)
    return TimeTags(np.concatenate(times), channel, channels, duration_s, unit_s)


def _channels(file: h5py.File, detectors: list[Ints]) -> tuple[Ints, int]:
    """Return the channel of each event, and their number: as listed, as stated, or the largest."""
    if bounded.is_in(file, "setup/detectors/id"):
        listed = bounded.numbers_in(file, "setup/detectors/id", "iu", 1)
        detector = np.concatenate(detectors)
        order = np.argsort(listed)
        place = order[np.searchsorted(listed, detector, sorter=order).clip(max=listed.size - 1)]
        if (listed[place] != detector).any():
            raise ValueError("an event of a detector that is not in setup/detectors/id")
        return place, listed.size
    largest = max(int(detector.max(initial=0)) for detector in detectors)
    total = int(_number_in(file, "setup/num_pixels", len(detectors) * (largest + 1)))
    of_a_spot = total // len(detectors)
    by_spot = [detector + of_a_spot * spot for spot, detector in enumerate(detectors)]
    return np.concatenate(by_spot if largest < of_a_spot else detectors), total


def _number_in(file: h5py.File, name: str, otherwise: float) -> float:
    is_stated = bounded.is_in(file, name)
    return float(bounded.numbers_in(file, name, "fiu", 0)) if is_stated else otherwise
