"""The index of finished sequences, rebuilt from the records: manifest, tables and splits.

`splits/train/Sintel/training/flow/SEQ` links to `training/flow/SEQ`, so that loaders of MPI-Sintel
read one split of a dataset. A copy with resolved links (`cp -rL`) is self-contained.

Tables of frames, sequences and exposures are described in Croissant 1.1,
https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html: JSON-LD for search engines and
loaders. The tables are its record sets; frames and counts are sets of files next to them.
"""

import errno
import hashlib
import json
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from megalopta import __version__
from megalopta.config.recipe import Plan
from megalopta.core import bounded, files
from megalopta.core.errors import DamagedFileError, UserError
from megalopta.dataset.layout import MANIFEST, Tree
from megalopta.dataset.record import SequenceRecord
from megalopta.dataset.store import file_hash

_SAMPLE = "sample"
"""Split of the first few sequences."""
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP)
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

_TERMS = (
    *("arrayShape", "citeAs", "column", "containedIn", "equivalentProperty", "extract", "field"),
    *("fileObject", "fileProperty", "fileSet", "format", "includes", "isArray", "isLiveDataset"),
    *("jsonPath", "key", "md5", "parentField", "path", "recordSet", "references", "regex"),
    *("repeated", "replace", "samplingRate", "separator", "source", "subField", "transform"),
)
"""Terms of Croissant's vocabulary."""
_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "description": {"@container": "@language"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "name": {"@container": "@language"},
    **{term: f"cr:{term}" for term in _TERMS},
}
LICENSE_URL = "https://creativecommons.org/publicdomain/zero/1.0/"
_SETS = {
    "radiance": ("radiance/*/*.exr", "image/x-exr", "Spectral radiance, W·m⁻²·sr⁻¹·nm⁻¹"),
    "truth": ("truth/*/*.exr", "image/x-exr", "Flow (px), depth (m), normals, object ids, masks"),
    "clean": ("training/clean/*/*.png", "image/png", "Radiance, tone-mapped"),
    "final": ("training/final/*/*.png", "image/png", "Counts of one exposure, tone-mapped"),
    "flow": ("training/flow/*/*.flo", "application/octet-stream", "Forward flow, Middlebury .flo"),
    "occlusions": ("training/occlusions/*/*.png", "image/png", "255 where unmatched"),
    "invalid": ("training/invalid/*/*.png", "image/png", "255 where flow is undefined"),
    "depth": ("training/depth/*/*.dpt", "application/octet-stream", "Depth (m), MPI-Sintel .dpt"),
    "counts": ("counts/*/*.zarr/**", "application/vnd.zarr", "Readings, Zarr v3"),
}
_TYPES = {pa.string(): "sc:Text", pa.int64(): "sc:Integer", pa.float64(): "sc:Float"}


class TableWriter:
    """Writes rows into the tables of a folder, some thousands in memory at a time."""

    def __init__(self, folder: Path, open_files: ExitStack) -> None:
        self._writers: dict[str, pq.ParquetWriter] = {}
        for name, schema in TABLES.items():
            temporary = open_files.enter_context(files.atomic_write(folder / f"{name}.parquet"))
            self._writers[name] = open_files.enter_context(pq.ParquetWriter(temporary, schema))
        self._rows: dict[str, list[dict[str, Any]]] = {name: [] for name in TABLES}

    def add(self, record: SequenceRecord) -> None:
        """Add the rows of a sequence."""
        key = {"sequence": record.sequence, "index": record.index, "split": record.split}
        tables = {"frames": _frames, "sequences": _sequence, "exposures": _exposures}
        for name, rows in tables.items():
            self._rows[name] += [{**key, **row} for row in rows(record)]
            if len(self._rows[name]) >= _ROWS_AT_ONCE:
                self._write(name)

    def finish(self) -> None:
        """Write the remaining rows."""
        for name in TABLES:
            self._write(name)

    def _write(self, name: str) -> None:
        table = pa.Table.from_pylist(self._rows[name], schema=TABLES[name])
        self._writers[name].write_table(table)
        self._rows[name] = []


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


def _sequence(record: SequenceRecord) -> Iterator[dict[str, Any]]:
    settings, statistics = record.configuration, record.statistics
    camera = settings["camera"]
    yield {
        "frames": record.frames,
        **{name: camera.get(name) for name in ("height", "width", "fov_deg")},
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


def croissant(root: Path, plan: Plan) -> dict[str, Any]:
    """Return the description of a dataset whose tables are written."""
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": plan.name,
        "description": plan.description,
        "license": LICENSE_URL,
        "url": "croissant.json",
        "version": __version__,
        "creator": {"@type": "sc:Organization", "name": f"megalopta {__version__}"},
        "citeAs": f"{plan.name}. Made with megalopta {__version__}.",
        "distribution": [
            *(_table(root / "index" / f"{name}.parquet", name) for name in TABLES),
            *(_file_set(name, *each) for name, each in _SETS.items()),
        ],
        "recordSet": [_record_set(name, schema) for name, schema in TABLES.items()],
    }


def table_path(root: Path, name: str) -> Path:
    """Return the path of a table of the index, after comparing it with its description.

    Raises UserError if the table or the description is missing, damaged or modified.
    """
    described, path = root / "croissant.json", root / "index" / f"{name}.parquet"
    again = f"run: megalopta dataset make {root} --out {root}"
    try:
        parts = bounded.read_json(described)["distribution"]
        hashes = {part.get("contentUrl"): part.get("sha256") for part in parts}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UserError(f"{described} is missing or damaged; {again}") from None
    try:
        found = _sha256(path)
    except OSError:
        raise UserError(f"{path} is missing; {again}") from None
    if found != hashes.get(f"index/{name}.parquet"):
        raise UserError(f"{path} differs from its description; {again}")
    return path


def _sha256(path: Path) -> str:
    bounded.check_file(path)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _table(path: Path, name: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": f"{name}.parquet",
        "name": f"{name}.parquet",
        "contentUrl": f"index/{name}.parquet",
        "contentSize": f"{path.stat().st_size} B",
        "encodingFormat": "application/x-parquet",
        "sha256": _sha256(path),
    }


def _file_set(name: str, pattern: str, encoding: str, meaning: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileSet",
        "@id": f"{name}-files",
        "name": f"{name}-files",
        "description": meaning,
        "encodingFormat": encoding,
        "includes": pattern,
    }


def _record_set(table: str, schema: pa.Schema) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": table,
        "name": table,
        "field": [_field(table, column) for column in schema],
    }


def _field(table: str, column: pa.Field) -> dict[str, Any]:
    is_list = pa.types.is_list(column.type)
    value = column.type.value_type if is_list else column.type
    return {
        "@type": "cr:Field",
        "@id": f"{table}/{column.name}",
        "name": column.name,
        "dataType": _TYPES[value],
        **({"isArray": True, "arrayShape": "16"} if is_list else {}),
        "source": {
            "fileObject": {"@id": f"{table}.parquet"},
            "extract": {"column": column.name},
        },
    }


def write_index(tree: Tree, plan: Plan) -> None:
    """Write manifest, tables, splits and Croissant file, with one record in memory at a time."""
    names: dict[str, list[str]] = {split: [] for split in plan.splits}
    names |= {_SAMPLE: []} if plan.sample else {}
    with ExitStack() as open_files:
        temporary = open_files.enter_context(files.atomic_write(tree.root / MANIFEST))
        manifest = open_files.enter_context(temporary.open("w", encoding="utf-8"))
        tables = TableWriter(tree.root / "index", open_files)
        for record in tree.all_records():
            if record.split not in names:
                raise DamagedFileError(
                    f"{tree.record_path(record.sequence)} is damaged (split {record.split!r} is "
                    "not in the plan); remove it and run megalopta dataset make again"
                )
            tables.add(record)
            line = {
                "sequence": record.sequence,
                "configuration": record.configuration_hash,
                "record": file_hash(tree.record_path(record.sequence)),
            }
            manifest.write(json.dumps(line) + "\n")
            sampled = [_SAMPLE] if record.index < plan.sample else []
            for split in [record.split, *sampled]:
                names[split].append(record.sequence)
                _link_into_split(tree.root, split, record)
        tables.finish()
    for split, found in names.items():
        lines = "".join(f"{name}\n" for name in found)
        files.write_text(tree.root / "splits" / f"{split}.txt", lines)
    files.write_json(tree.root / "croissant.json", croissant(tree.root, plan))


def _link_into_split(root: Path, split: str, record: SequenceRecord) -> None:
    """Link the Sintel folders of a sequence into a split; skipped where links are not supported."""
    kinds = {Path(path).parts[1] for path in record.files if path.startswith("training/")}
    for kind in sorted(kinds):
        link = root / "splits" / split / "Sintel" / "training" / kind / record.sequence
        if link.is_symlink():
            continue
        link.parent.mkdir(parents=True, exist_ok=True)
        try:
            link.symlink_to(Path("../../../../..") / "training" / kind / record.sequence)
        except OSError as problem:
            if problem.errno not in _NO_LINKS:
                raise


def read_lists(root: Path, known: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return the names of the sequences of every split; unknown ones are refused."""
    found, known = {}, set(known)
    for path in sorted((root / "splits").glob("*.txt")):
        try:
            found[path.stem] = tuple(bounded.read_text(path).split())
        except ValueError:
            raise UserError(f"{path}: not a UTF-8 text file; {_remedy(root)}") from None
        if strangers := [name for name in found[path.stem] if name not in known]:
            raise UserError(
                f"{path}: no sequence {bounded.quoted(strangers[0], 60)!r}; {_remedy(root)}"
            )
    return found


def _remedy(root: Path) -> str:
    return f"rewrite it: megalopta dataset make {root} --out {root}"
