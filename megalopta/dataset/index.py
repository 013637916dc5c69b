"""The index of finished sequences, made from their records: tables, splits, Croissant 1.1.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html; splits link as trees of Sintel
and KITTI.
"""

import errno
import json
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from megalopta import __version__
from megalopta.config.recipe import Plan
from megalopta.core import bounded, files, strict_yaml
from megalopta.core.errors import DamagedFileError, UserError
from megalopta.dataset.record import SequenceRecord
from megalopta.dataset.store import Tree, frame_file
from megalopta.scenes.hashed_file import sha256_of

_SAMPLE = "sample"
"""Split of the first few sequences."""
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP)

_TYPES = {
    "string": (pa.string(), "sc:Text"),
    "int64": (pa.int64(), "sc:Integer"),
    "double": (pa.float64(), "sc:Float"),
    "list": (pa.list_(pa.float64()), "sc:Float"),
}
_DATA = strict_yaml.load(Path(__file__).with_suffix(".yaml").read_text("utf-8"))
TABLES: dict[str, pa.Schema] = {
    table: pa.schema([(name, _TYPES[kind][0]) for name, kind in columns.items()])
    for table, columns in _DATA["tables"].items()
}
"""Columns of each table."""


def _frames(record: SequenceRecord) -> Iterator[dict[str, Any]]:
    rate = record.configuration["trajectory"]["frame_rate_hz"]
    for index, pose in enumerate(record.poses):
        paths = {
            name: frame_file(kind, record.sequence, index) for name, kind in _DATA["kinds"].items()
        }
        yield {
            "frame": index + 1,
            "time_s": index / rate,
            **{name: path if path in record.files else None for name, path in paths.items()},
            "camera_to_world": pose,
        }


def _sequence(record: SequenceRecord) -> Iterator[dict[str, Any]]:
    settings, statistics = record.configuration, record.statistics
    assert statistics is not None
    camera = settings["camera"]
    yield {
        "frames": settings["trajectory"]["frames"],
        **{name: camera.get(name) for name in ("height", "width", "fov_deg")},
        "bytes": sum(size for size, _ in record.files.values()),
        "frame_rate_hz": settings["trajectory"]["frame_rate_hz"],
        "scene": settings["scene"]["kind"],
        "light": settings["light"]["level"],
        "trajectory": settings["trajectory"]["kind"],
        "camera_kind": camera["kind"],
        **statistics.model_dump(exclude={"exposures"}),
        "record": f"sequences/{record.sequence}.json",
        "configuration": json.dumps(settings, sort_keys=True),
    }


def _exposures(record: SequenceRecord) -> Iterator[dict[str, Any]]:
    for exposure in record.exposures:
        values = exposure.model_dump(exclude={"name"})
        values["level"] = str(exposure.level)
        yield {
            **values,
            "exposure": exposure.name,
            "counts": f"counts/{record.sequence}/{exposure.name}.zarr",
        }


def croissant(root: Path, plan: Plan, version: str = __version__) -> dict[str, Any]:
    """Return the description of a dataset whose tables are written, by a version of the program."""
    paths = {table: root / "index" / f"{table}.parquet" for table in TABLES}
    tables = [
        {
            "@type": "cr:FileObject", "@id": path.name, "name": path.name,
            "contentUrl": f"index/{path.name}", "contentSize": f"{path.stat().st_size} B",
            "encodingFormat": "application/x-parquet", "sha256": sha256_of(path),
        }
        for path in paths.values()
    ]  # fmt: skip
    file_sets = [
        {
            "@type": "cr:FileSet", "@id": f"{name}-files", "name": f"{name}-files",
            "description": meaning, "encodingFormat": encoding, "includes": pattern,
        }
        for name, (pattern, encoding, meaning) in _DATA["file_sets"].items()
    ]  # fmt: skip
    record_sets = []
    for table, columns in _DATA["tables"].items():
        fields = [
            {
                "@type": "cr:Field",
                "@id": f"{table}/{name}",
                "name": name,
                "dataType": _TYPES[kind][1],
                **({"isArray": True, "arrayShape": "16"} if kind == "list" else {}),
                "source": {"fileObject": {"@id": paths[table].name}, "extract": {"column": name}},
            }
            for name, kind in columns.items()
        ]
        record_sets.append({"@type": "cr:RecordSet", "@id": table, "name": table, "field": fields})
    return {
        **_DATA["croissant"],
        "name": plan.name,
        "description": plan.description,
        "version": version,
        "creator": {"@type": "sc:Organization", "name": f"megalopta {version}"},
        "citeAs": f"{plan.name}. Made with megalopta {version}.",
        "distribution": [*tables, *file_sets],
        "recordSet": record_sets,
    }


def table_path(root: Path, name: str) -> Path:
    """Return the path of a table of the index, after comparing it with its description.

    Raises UserError if the table or the description is missing, damaged or modified.
    """
    described, path = root / "croissant.json", root / "index" / f"{name}.parquet"
    again = f"run: {Tree(root).make_again}"
    with bounded.undamaged(described, again):
        parts = bounded.read_json(described)["distribution"]
        hashes = {part.get("contentUrl"): part.get("sha256") for part in parts}
    with bounded.undamaged(path, again):
        digest = sha256_of(path)
    if digest != hashes.get(f"index/{name}.parquet"):
        raise UserError(f"{path} differs from its description; {again}")
    with bounded.undamaged(path, again):
        stated = pq.read_metadata(path)
        # 200 bytes of memory are a number of a table as Python reads it
        bounded.check_decoded(path, (stated.num_rows, stated.num_columns), 200)
    return path


def write_index(tree: Tree, plan: Plan) -> None:
    """Write tables, splits and Croissant file, with one record in memory at a time."""
    names: dict[str, list[str]] = {split: [] for split in plan.splits}
    names |= {_SAMPLE: []} if plan.sample else {}
    rows_of = {"frames": _frames, "sequences": _sequence, "exposures": _exposures}
    with ExitStack() as open_files:
        writers = {}
        for table, schema in TABLES.items():
            path = tree.root / "index" / f"{table}.parquet"
            temporary = open_files.enter_context(files.atomic_write(path))
            writers[table] = open_files.enter_context(pq.ParquetWriter(temporary, schema))
        waiting: dict[str, list[dict[str, Any]]] = {table: [] for table in TABLES}

        def write(least: int) -> None:
            for table, rows in waiting.items():
                if len(rows) >= least:
                    writers[table].write_table(pa.Table.from_pylist(rows, schema=TABLES[table]))
                    waiting[table] = []

        for record in map(tree.record, tree.names()):
            if record.split not in names or record.statistics is None:
                raise DamagedFileError(
                    f"{tree.record_path(record.sequence)} is damaged (its split {record.split!r} "
                    "or its statistics); remove it and run megalopta dataset make again"
                )
            key = {"sequence": record.sequence, "index": record.index, "split": record.split}
            key["path"], key["camera"] = divmod(record.index, plan.cameras_per_path)
            for table, rows in rows_of.items():
                waiting[table] += [{**key, **row} for row in rows(record)]
            write(10_000)  # rows at once
            for split in splits_of(record, plan):
                names[split].append(record.sequence)
                for link, target in split_links(tree.root, split, record).items():
                    _link(link, target)
        write(0)
    for split, members in names.items():
        lines = "".join(f"{name}\n" for name in members)
        files.write_text(tree.root / "splits" / f"{split}.txt", lines)
    files.write_json(tree.root / "croissant.json", croissant(tree.root, plan))


def splits_of(record: SequenceRecord, plan: Plan) -> list[str]:
    """Return the splits of a sequence."""
    return [record.split, *([_SAMPLE] if record.index < plan.sample else [])]


def split_links(root: Path, split: str, record: SequenceRecord) -> dict[Path, Path]:
    """Return the links of a split to a sequence, in trees of Sintel and KITTI, with targets."""
    name, above = record.sequence, Path("../../../../..")
    folders = sorted(folder for folder in record.folders if folder.startswith("training/"))
    targets = {f"Sintel/{folder}": folder for folder in folders}
    pairs = len(record.poses) - 1 if f"training/flow_kitti/{name}" in folders else 0
    for index in range(pairs):
        for link, (kind, later) in _DATA["kitti"].items():
            pair = link.format(f"{name}-{index + 1:04d}")
            targets[f"KittiFlow/training/{pair}"] = frame_file(kind, name, index + later)
    return {root / "splits" / split / link: above / target for link, target in targets.items()}


def _link(link: Path, target: Path) -> None:
    """Write a link; skipped where links are not supported."""
    if link.is_symlink() or link.exists():  # exists: a copy whose links were followed
        return
    link.parent.mkdir(parents=True, exist_ok=True)
    try:
        link.symlink_to(target)
    except OSError as problem:
        if problem.errno not in _NO_LINKS:
            raise


def read_lists(root: Path, known: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return the names of the sequences of every split; unknown ones are refused."""
    lists, known, again = {}, set(known), f"rewrite it: {Tree(root).make_again}"
    for path in sorted((root / "splits").glob("*.txt")):
        with bounded.undamaged(path, again):
            lists[path.stem] = tuple(bounded.read_text(path).split())
        if strangers := [name for name in lists[path.stem] if name not in known]:
            raise UserError(f"{path}: no sequence {bounded.quoted(strangers[0], 60)!r}; {again}")
    return lists
