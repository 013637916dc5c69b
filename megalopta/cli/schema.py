"""JSON schemas of YAML files, with which an editor completes and checks them."""

import json
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from megalopta.benchmark.trial import Sweep
from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.sensor import IMAGE_SENSORS

_DRAWS = {name: {"type": "array"} for name in ("uniform", "log_uniform", "integer", "one_of")}
_RANGE = {"type": "object", "properties": _DRAWS, "additionalProperties": False}


def schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON schemas of a configuration, a plan, a sensor and a sweep."""
    schema: dict[str, dict[str, Any]] = {}
    for name, model in ("configuration", Configuration), ("plan", Plan), ("sweep", Sweep):
        text = json.dumps(TypeAdapter(model).json_schema())
        schema[name] = json.loads(text.replace('"oneOf"', '"anyOf"'))  # kinds have defaults
    configuration = schema["configuration"]
    for name, definition in configuration["$defs"].items():
        stated = definition.get("properties", {})
        if "sha256" in stated or name == "SceneFile":  # a path alone is enough
            definition["type"] = ["object", "string"]
        elif "wavelengths_nm" in stated:
            stated["path"] = {"type": "string"}
    configuration["$defs"]["Meshes"]["properties"]["files"]["type"] = ["array", "string"]
    preset = {"type": "string", "examples": [*IMAGE_SENSORS]}  # or a device's file
    fields: dict[str, Any] = {"preset": preset}
    for kind in configuration["properties"]["sensors"]["items"]["anyOf"]:
        definition = configuration["$defs"][kind["$ref"].rpartition("/")[2]]
        for key, value in definition["properties"].items():
            fields[key] = {"anyOf": [*fields.get(key, {}).get("anyOf", ()), value]}
    sensor = {"type": "object", "properties": fields, "additionalProperties": False}
    configuration["properties"]["sensors"]["items"] = {"anyOf": [preset, sensor]}
    configuration["$defs"] = _changes(configuration["$defs"])
    schema["sensor"] = {**sensor, "$defs": configuration["$defs"]}

    # of a plan any value may be a range, and presets supply what is missing
    parts = {"preset": {"type": "string"}, **_changes(configuration["properties"], has_ranges=True)}
    every = {"type": "object", "properties": parts, "additionalProperties": False}
    plan = schema["plan"]["properties"]
    plan |= {"every": every, "light_levels": parts["light_levels"], "sensors": parts["sensors"]}
    entries = {"lights": "light", "cameras": "camera", "trajectories": "trajectory"}
    for name, entry in [("scenes", every), *((name, parts[entries[name]]) for name in entries)]:
        plan[name]["items"] = {"anyOf": [{"type": ["string", "number"]}, entry]}
    schema["plan"]["$defs"] |= _changes(configuration["$defs"], has_ranges=True)
    return schema


def _changes(node: Any, has_ranges: bool = False) -> Any:
    """Return a schema in which nothing is required, and any value may be a range."""
    if isinstance(node, list):
        return [_changes(part, has_ranges) for part in node]
    if not isinstance(node, dict):
        return node
    changed = {key: _changes(part, has_ranges) for key, part in node.items() if key != "required"}
    is_value = "$ref" in node or "anyOf" in node or isinstance(node.get("type"), str)
    return {"anyOf": [changed, _RANGE]} if has_ranges and is_value else changed


def write_schemas(folder: Path) -> list[Path]:
    """Write NAME.schema.json for configurations, plans, sensors and sweeps; return their paths."""
    by_path = {folder / f"{name}.schema.json": schema for name, schema in schemas().items()}
    for path, schema in by_path.items():
        files.write_json(path, schema)
    return [*by_path]
