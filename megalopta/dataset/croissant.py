"""The dataset described in Croissant 1.1, JSON-LD that search engines and loaders read.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html. The tables of the index are its
record sets; frames and counts are sets of files beside them.
"""

import hashlib
from pathlib import Path
from typing import Any

import pyarrow as pa

from megalopta import __version__
from megalopta.config.recipe import Plan
from megalopta.core import bounded
from megalopta.core.errors import UserError
from megalopta.dataset.tables import TABLES

_TERMS = [
    "arrayShape",
    "citeAs",
    "column",
    "containedIn",
    "equivalentProperty",
    "extract",
    "field",
    "fileObject",
    "fileProperty",
    "fileSet",
    "format",
    "includes",
    "isArray",
    "isLiveDataset",
    "jsonPath",
    "key",
    "md5",
    "parentField",
    "path",
    "recordSet",
    "references",
    "regex",
    "repeated",
    "replace",
    "samplingRate",
    "separator",
    "source",
    "subField",
    "transform",
]
"""Of Croissant's vocabulary."""
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
    """Return where a table of the index lies, after comparing it with its description.

    Raises
    ------
    UserError
        When the table or the description is missing, damaged or not as it was written.
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
        raise UserError(f"{path} is not as it was written; {again}")
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
