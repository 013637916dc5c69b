"""Rows of the index: of frames, of sequences and of exposures, with relative paths."""

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from megalopta.core.files import atomic_write
from megalopta.dataset.record import SequenceRecord

_ROWS_AT_ONCE = 10_000

_KEY = (("sequence", pa.string()), ("index", pa.int64()), ("split", pa.string()))
_PATHS = {
    "radiance": "radiance/{}/{}.exr",
    "truth": "truth/{}/{}.exr",
    "clean": "training/clean/{}/{}.png",
    "final": "training/final/{}/{}.png",
    "flow": "training/flow/{}/{}.flo",
    "occlusions": "training/occlusions/{}/{}.png",
    "invalid": "training/invalid/{}/{}.png",
    "depth": "training/depth/{}/{}.dpt",
    "camera": "training/camdata_left/{}/{}.cam",
    "flow_kitti": "training/flow_kitti/{}/{}.png",
    "flow_flo5": "training/flow_flo5/{}/{}.flo5",
}
_STATISTICS = (
    *("mean_speed_px", "median_speed_px", "percentile_99_speed_px", "unmatched_fraction"),
    *("sky_fraction", "median_depth_m", "texture"),
)
TABLES: dict[str, pa.Schema] = {
    "frames": pa.schema(
        [
            *_KEY,
            ("frame", pa.int64()),
            ("time_s", pa.float64()),
            *((name, pa.string()) for name in _PATHS),
            ("camera_to_world", pa.list_(pa.float64())),
        ]
    ),
    "sequences": pa.schema(
        [
            *_KEY,
            *((name, pa.int64()) for name in ("frames", "height", "width", "bytes")),
            *((name, pa.float64()) for name in ("frame_rate_hz", "fov_deg")),
            *((name, pa.string()) for name in ("scene", "light", "trajectory", "camera_kind")),
            *((name, pa.float64()) for name in _STATISTICS),
            ("record", pa.string()),
            ("configuration", pa.string()),
        ]
    ),
    "exposures": pa.schema(
        [
            *_KEY,
            *((name, pa.string()) for name in ("exposure", "sensor", "level", "unit", "counts")),
            *((name, pa.float64()) for name in ("exposure_s", "photons_per_pixel")),
            *((name, pa.float64()) for name in ("mean_reading", "saturated_fraction")),
        ]
    ),
}
"""Columns of each table."""


def rows_of(record: SequenceRecord) -> dict[str, list[dict[str, Any]]]:
    """Rows of a sequence in every table."""
    key = {"sequence": record.sequence, "index": record.index, "split": record.split}
    rows = {
        "frames": list(_frames(record)),
        "sequences": [_sequence(record)],
        "exposures": list(_exposures(record)),
    }
    return {table: [{**key, **row} for row in found] for table, found in rows.items()}


class TableWriter:
    """Writes rows into the tables of a folder, some thousands in memory at a time."""

    def __init__(self, folder: Path, open_files: ExitStack) -> None:
        self._writers = {
            name: open_files.enter_context(_writer(folder / f"{name}.parquet", schema))
            for name, schema in TABLES.items()
        }
        self._rows: dict[str, list[dict[str, Any]]] = {name: [] for name in TABLES}

    def add(self, record: SequenceRecord) -> None:
        """Add the rows of a sequence."""
        for name, rows in rows_of(record).items():
            self._rows[name] += rows
            if len(self._rows[name]) >= _ROWS_AT_ONCE:
                self._write(name)

    def finish(self) -> None:
        """Write what is left."""
        for name in TABLES:
            self._write(name)

    def _write(self, name: str) -> None:
        table = pa.Table.from_pylist(self._rows[name], schema=TABLES[name])
        self._writers[name].write_table(table)
        self._rows[name] = []


@contextmanager
def _writer(path: Path, schema: pa.Schema) -> Iterator[pq.ParquetWriter]:
    with atomic_write(path) as temporary, pq.ParquetWriter(temporary, schema) as writer:
        yield writer


def _frames(record: SequenceRecord) -> Iterator[dict[str, Any]]:
    rate = record.configuration["trajectory"]["frame_rate_hz"]
    for index, pose in enumerate(record.poses):
        file = f"frame_{index + 1:04d}"
        paths = {name: path.format(record.sequence, file) for name, path in _PATHS.items()}
        yield {
            "frame": index + 1,
            "time_s": index / rate,
            **{name: path if path in record.files else None for name, path in paths.items()},
            "camera_to_world": pose,
        }


def _sequence(record: SequenceRecord) -> dict[str, Any]:
    settings, statistics = record.configuration, record.statistics
    camera = settings["camera"]
    return {
        "frames": record.frames,
        **{name: camera[name] for name in ("height", "width", "fov_deg")},
        "bytes": sum(size for size, _ in record.files.values()),
        "frame_rate_hz": settings["trajectory"]["frame_rate_hz"],
        "scene": settings["scene"]["kind"],
        "light": settings["light"]["level"],
        "trajectory": settings["trajectory"]["kind"],
        "camera_kind": camera["kind"],
        **{name: getattr(statistics, name) for name in _STATISTICS},
        "record": f"sequences/{record.sequence}.json",
        "configuration": json.dumps(settings, sort_keys=True),
    }


def _exposures(record: SequenceRecord) -> Iterator[dict[str, Any]]:
    for each in record.exposures:
        values = each.model_dump(exclude={"name"})
        values["level"] = str(each.level)
        yield {
            **values,
            "exposure": each.name,
            "counts": f"counts/{record.sequence}/{each.name}.zarr",
        }
