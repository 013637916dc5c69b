"""Tables of rates, crosstalk and afterpulses of real arrays, recognized by their content.

    pix1,pix2,distance,crosstalk,error     pairs of pixels, numbered along rows; distance in pixels
    events,duration_s,100-137.5,…          events of a pixel, and pairs of them by lag (ns)
    numbers without a head, or .npy        map of dark counts, per second or frame

`docs/public_arrays` has those of two arrays of 12 × 4 pixels.
"""

import csv
import io
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from megalopta.core import bounded
from megalopta.core.arrays import Floats
from megalopta.core.errors import DamagedFileError
from megalopta.core.files import write_csv
from megalopta.sensor.calibrate import time_tags
from megalopta.sensor.calibrate.crosstalk import PairCrosstalk
from megalopta.sensor.formats.time_tags import TimeTags

_FEWEST, _MOST_NUMBERS = 12, 10**7
_PAIR = ("pix1", "pix2", "distance", "crosstalk", "error")
_EDGES_NS = np.concatenate((np.arange(0, 100, 12.5), np.geomspace(100, 25600, 33)))
_KINDS = "give crosstalk of pairs, an autocorrelation or a map of dark counts"

Measurement = PairCrosstalk | time_tags.Autocorrelation | Floats


def read_measurement(path: Path) -> Measurement:
    """Read a measurement. Raises DamagedFileError for other content, OSError if unreadable."""
    content = bounded.read_bytes(path, bounded.TEXT_BYTES)
    try:
        if path.suffix == ".npy":
            return _map(bounded.plain_array(content))
        rows = [row for row in csv.reader(io.StringIO(content.decode("utf-8"))) if row]
        bounded.check_count(path, "numbers", content.count(b",") + len(rows), _MOST_NUMBERS)
        if len({len(row) for row in rows}) != 1:
            raise ValueError("lines of different numbers of columns" if rows else "empty")
        if set(_PAIR) <= set(rows[0]):
            return _pairs(rows)
        if rows[0][0] == "events":
            return _autocorrelation(rows)
        return _map(np.array([[float(cell) for cell in row] for row in rows]))
    except (ValueError, csv.Error) as problem:
        raise DamagedFileError(f"{path}: {bounded.printable(str(problem))}; {_KINDS}") from None


def write_measurements(folder: Path, tags: TimeTags, columns: int, window_s: float) -> list[Path]:
    """Write what time tags in the dark show as files that `read_measurement` reads.

    Channels are pixels, numbered along rows of so many columns. Raises ValueError if they do not
    fill the rows.
    """
    if tags.channels % columns:
        raise ValueError(f"{tags.channels} channels in rows of {columns}; give --columns")
    rates = (time_tags.events_of(tags) / tags.duration_s).reshape(-1, columns)
    lags = time_tags.autocorrelation_of(tags, _EDGES_NS * 1e-9)
    names = (f"{start:g}-{end:g}" for start, end in pairwise(_EDGES_NS))
    events = np.column_stack([lags.events, np.full(len(lags.events), tags.duration_s), lags.pairs])
    written = {
        "dark-counts.csv": rates.tolist(),
        "autocorrelation.csv": [["events", "duration_s", *names], *events.tolist()],
    }
    if tags.channels > columns > 1:
        pairs = time_tags.coincidences(tags, window_s)
        (row, column), (other_row, other_column) = (
            np.divmod(pixel, columns) for pixel in (pairs.first, pairs.second)
        )
        distance = np.hypot(other_row - row, other_column - column)
        values = pairs.first, pairs.second, distance, pairs.probability, pairs.error
        written["crosstalk.csv"] = [list(_PAIR), *np.transpose(values).tolist()]
    for name, (head, *rows) in written.items():
        heads = (f"{value:.5g}" if isinstance(value, float) else value for value in head)
        write_csv(folder / name, heads, rows, digits=9)
    return [folder / name for name in written]


def _map(rates: Floats | None) -> Floats:
    if rates is None or rates.ndim != 2:
        raise ValueError("no array (rows, columns) of plain numbers")
    rates = rates.astype(np.float64)
    known = rates[np.isfinite(rates)]
    if not known.size or known.min() < 0:
        raise ValueError("rates are negative, or none is known")
    return rates


def _pairs(rows: Sequence[Sequence[str]]) -> PairCrosstalk:
    places = [rows[0].index(name) for name in _PAIR]
    table = np.array([[float(row[at] or "nan") for at in places] for row in rows[1:]])
    table = table[np.isfinite(table).all(axis=1)]
    first, second = table[:, :2].astype(np.int64).T
    below = (np.abs(table[:, 2] - 1) < 0.01) & (np.abs(second - first) > 1)
    if len(table) < _FEWEST or not below.any() or first.min() < 0:
        raise ValueError(f"{len(table)} pairs, without two pixels of a column at a distance of 1")
    columns = int(np.abs(second - first)[below].min())
    (row, column), (other_row, other_column) = (divmod(pixel, columns) for pixel in (first, second))
    middle = (column + other_column) / 2
    distances = np.abs(other_row - row), np.abs(other_column - column)
    return PairCrosstalk(*distances, middle, table[:, 3], table[:, 4])


def _autocorrelation(rows: Sequence[Sequence[str]]) -> time_tags.Autocorrelation:
    lags = [[float(end) for end in text.split("-")] for text in rows[0][2:]]
    edges = np.array([*(lag[0] for lag in lags), lags[-1][1]]) * 1e-9
    table = np.array([[float(cell) for cell in row] for row in rows[1:]], ndmin=2)
    if (np.diff(edges) <= 0).any() or not (table[:, 0] > 0).all():
        raise ValueError(f"{len(table)} pixels with events, or lags that do not increase")
    return time_tags.Autocorrelation(edges, table[:, 2:], table[:, 0])
