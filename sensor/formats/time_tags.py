"""Reader of time tags: PicoQuant's `.ptu`, by `ptufile`, Photon-HDF5, and LinoSPAD2, by `daplis`.

A tag is the time of an event and its channel, a pixel. In a `.ptu` file of mode T2 the time is
absolute; of mode T3 it is that of the laser pulse before, plus the time since. Photon-HDF5 has
`timestamps` with their unit, in `photon_data`, or in `photon_data0`, `photon_data1`, … of several
spots; each detector of each spot is a channel, in order. LinoSPAD2's `.dat` files (firmware 2212)
do not say what they are. Half a sensor has 256 pixels, four at each of 64 converters, and each
acquisition cycle begins with its time on the camera's clock.

Layouts: ptufile (C. Gohlke); Photon-HDF5 0.5, Ingargiola et al., Biophys. J. 110, 26 (2016);
daplis (S. Kulkov et al.).
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

import h5py
import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import ARRAY_BYTES, check_file, read_bytes, undamaged
from megalopta.core.errors import DamagedFileError
from megalopta.sensor.formats.events import HDF5_SIGNATURE
from megalopta.sensor.formats.recorded_frames import file_bytes

_PTU_SIGNATURE = b"PQTTTR\0\0"
_CONVERTERS, _PIXELS_EACH = 64, 4
_CODE_S, _CLOCK_S = 2.5e-9 / 140, 7.5e-9
"""Steps of LinoSPAD2's converters, on average, and of its clock, s"""
_MOST_DAT_BYTES = 2**30
"""Largest `.dat` file: in memory it takes twenty times as much."""


class TimeTags(NamedTuple):
    """Events of a free-running array, sorted by time."""

    time_s: Floats
    """(N,)"""
    channel: Ints
    """Pixel of each event, (N,)"""
    channels: int
    duration_s: float
    """From the first event to the last"""
    unit_s: float = 0.0
    """Step of the times; 0: continuous"""


def read_time_tags(path: str | Path) -> TimeTags:
    """Read a `.ptu` or Photon-HDF5 file.

    Raises FileNotFoundError if the path does not exist; ValueError if the file is of another format
    or damaged; ModuleNotFoundError if a `.ptu` file needs `ptufile`, which is not installed.
    """
    path = Path(path)
    beginning = file_bytes(path)[:8].tobytes()
    if beginning == _PTU_SIGNATURE:
        read = _ptu
    elif beginning == HDF5_SIGNATURE:
        read = _photon_hdf5
    else:
        raise DamagedFileError(f"{path}: no time tags; give a .ptu or Photon-HDF5 file")
    with undamaged(path):
        time_s, channel, unit_s = read(path)
    return _sorted(path, time_s, channel, unit_s)


def read_linospad2(
    path: str | Path, firmware: Literal["2212b", "2212s"], per_cycle: int = 512
) -> TimeTags:
    """Read a `.dat` file of half a LinoSPAD2, with the times of its cycles.

    Raises ValueError if the file's size is not that of such cycles; ModuleNotFoundError if `daplis`
    is not installed.

    Parameters
    ----------
    firmware : str
        2212b: a converter has four neighboring pixels; 2212s: every 64th.
    per_cycle : int
        Time stamps of a converter in an acquisition cycle.
    """
    path = Path(path)
    words, rest = divmod(file_bytes(path).size, 4)
    if rest or words % (cycle := (_CONVERTERS + 1) * per_cycle + 2):
        raise DamagedFileError(
            f"{path}: {words} words are not cycles of {cycle}, of {per_cycle} time stamps each and "
            "an absolute time; state the recording's time stamps per cycle, or record with them"
        )
    check_file(path, _MOST_DAT_BYTES)
    time_s, channel = _linospad2(path, firmware, per_cycle)
    return _sorted(path, time_s, channel, _CODE_S)._replace(channels=_CONVERTERS * _PIXELS_EACH)


def _linospad2(path: Path, firmware: str, per_cycle: int) -> tuple[Floats, Ints]:
    from matplotlib import rc_context

    with rc_context():  # daplis changes the style of all figures
        from daplis.functions.unpack import unpack_binary_data_with_absolute_timestamps as unpack

    pixel, code, start = unpack(str(path), "", "", firmware, per_cycle)
    converter = np.arange(_CONVERTERS)[:, None]
    block = firmware == "2212b"
    own = pixel.astype(np.int64)
    place = converter * _PIXELS_EACH + own if block else converter + _CONVERTERS * own
    from_first = (start - start.min()).astype(np.float64)
    time_s = _CLOCK_S * np.repeat(from_first, per_cycle) + _CODE_S * code
    return time_s[code >= 0], place[code >= 0]


def _sorted(path: Path, time_s: Floats, channel: Ints, unit_s: float) -> TimeTags:
    if time_s.size < 2:
        raise DamagedFileError(f"{path}: {time_s.size} events; give a file with more")
    order = np.argsort(time_s, kind="stable")
    time_s, channel = time_s[order], channel[order]
    duration_s = float(time_s[-1] - time_s[0])
    return TimeTags(time_s, channel, int(channel.max()) + 1, duration_s, unit_s)


def _ptu(path: Path) -> tuple[Floats, Ints, float]:
    import io

    import ptufile

    with ptufile.PtuFile(io.BytesIO(read_bytes(path, ARRAY_BYTES))) as file:
        records = file.decode_records()
        records = records[records["channel"] >= 0]
        unit_s = file.global_resolution
        time_s = records["time"] * unit_s
        if file.is_t3:
            unit_s = file.tcspc_resolution
            time_s = time_s + records["dtime"] * unit_s
    return np.asarray(time_s, np.float64), records["channel"].astype(np.int64), unit_s


def _photon_hdf5(path: Path) -> tuple[Floats, Ints, float]:
    times, channels, first, unit = [], [], 0, 0.0
    with h5py.File(path, "r") as file:
        for group in _groups(file):
            unit = float(file[f"{group}/timestamps_specs/timestamps_unit"][()])
            stamps = _numbers(file, f"{group}/timestamps")
            own = np.zeros(stamps.size, np.int64)
            count = 1
            if f"{group}/detectors" in file:
                names, own = np.unique(_numbers(file, f"{group}/detectors"), return_inverse=True)
                count = names.size
            if own.size != stamps.size or not 0 < unit < 1:
                raise ValueError(f"{own.size} detectors of {stamps.size} times, unit of {unit} s")
            times.append(stamps * unit)
            channels.append(own + first)
            first += count
    return np.concatenate(times), np.concatenate(channels), unit


def _groups(file: h5py.File) -> Iterator[str]:
    """Names of the groups of photons, in order of the spots."""
    found = [name for name in file if name.startswith("photon_data")]
    if not found:
        raise ValueError("no photon_data")
    yield from sorted(found, key=lambda name: int(name.removeprefix("photon_data") or 0))


def _numbers(file: h5py.File, name: str) -> Ints:
    data = file[name]
    link = file.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink) or data.is_virtual or data.external:
        raise ValueError(f"{name} is no array of this file")
    if data.ndim != 1 or data.dtype.kind not in "iu" or data.nbytes > ARRAY_BYTES:
        raise ValueError(f"{name} is {data.dtype} {data.shape}")
    return np.asarray(data[...], np.int64)
