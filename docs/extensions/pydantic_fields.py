"""Fields of configurations as tables, made of the models: meaning, default and range.

A page of all that a YAML file can hold, and a table below every model of the reference.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.errors import PydanticInvalidForJsonSchema
from sphinx.application import Sphinx

from megalopta.benchmark.design import DesignSettings
from megalopta.benchmark.ranking import RankingSettings
from megalopta.benchmark.trial import Sweep
from megalopta.config.model import Configuration
from megalopta.core import strict_yaml

Schema = Mapping[str, Any]
PAGE = "generated/configuration.rst"
ROOTS: tuple[tuple[type[BaseModel], str], ...] = (
    (Configuration, "What ``megalopta render``, ``sense``, ``flow`` and ``demo`` read."),
    (RankingSettings, "Options of ``megalopta benchmark sequence``."),
    (DesignSettings, "Options of ``megalopta design``."),
    (Sweep, "A sweep, which ``megalopta benchmark photons`` reads."),
)
INTRODUCTION = (
    "A setting is a key of the YAML file and an option of the command line, named by its path: "
    "``scene: {trees: 300}`` and ``--scene.trees 300``. A name ends in its unit. The program also "
    "checks bounds that only the text states, and refuses a wrong value in one sentence."
)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the page before pages are read, and add the tables to the reference."""
    app.connect("builder-inited", lambda app: write_page(Path(app.srcdir) / PAGE))
    app.connect("autodoc-process-docstring", _add_table, priority=400)  # before numpydoc
    app.connect(
        "autodoc-skip-member", lambda app, what, name, *_: name.startswith("model_") or None
    )
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write_page(path: Path) -> None:
    """Write every model that a configuration can hold, each below the file that it is part of."""
    lines, written = ["Settings", "========", "", INTRODUCTION, ""], set[str]()
    for model, what in ROOTS:
        schema = model.model_json_schema()
        parts = schema.get("$defs", {})
        models = {model.__name__: schema | {"description": what}}
        models |= {name: part for name, part in parts.items() if name not in written}
        for name, part in models.items():
            line = ("-" if name == model.__name__ else "~") * len(name)
            about = what if name == model.__name__ else _text(part.get("description", ""))
            lines += [f".. _setting-{name}:", "", name, line, "", about, ""]
            lines += table(part, set(parts))
        written |= set(models)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines), "utf-8")


def table(schema: Schema, linked: set[str] = frozenset()) -> list[str]:
    """Lines of a table of the fields of one model; models in `linked` have a section."""
    rows = [("Field", "Meaning", "Default", "Range")]
    for name, field in schema.get("properties", {}).items():
        meaning = _text(field.get("description", ""))
        rows.append((f"``{name}``", meaning, _default(field), _range(field, linked)))
    if len(rows) == 1:
        return []
    lines = [".. list-table::", "   :header-rows: 1", "   :class: settings", ""]
    for row in rows:
        lines += [f"   {'* -' if i == 0 else '  -'} {cell}".rstrip() for i, cell in enumerate(row)]
    return [*lines, ""]


def _default(field: Schema) -> str:
    value = field.get("default", "—")
    if isinstance(value, Mapping):
        return f"``{value['kind']}``" if "kind" in value else "as below"
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        return f"``[{', '.join(item.get('name', '…') for item in value)}]``"
    text = strict_yaml.dump(value, default_flow_style=True, width=10_000)
    text = text.strip().removesuffix("...").strip()
    shown = text if len(text) <= 120 else f"{text[:120].strip()} …"
    return value if value == "—" else f"``{shown}``"


def _range(field: Schema, linked: set[str]) -> str:
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return f":ref:`{name} <setting-{name}>`" if name in linked else name
    for key in ("anyOf", "oneOf"):
        if key in field:
            return " or ".join(dict.fromkeys(_range(option, linked) for option in field[key]))
    if "const" in field or "enum" in field:
        return ", ".join(f"``{value}``" for value in field.get("enum") or [field["const"]])
    kind, items = field.get("type", "anything"), field.get("items") or {}
    if "prefixItems" in field:
        return f"[{', '.join(_range(item, linked) for item in field['prefixItems'])}]"
    bounds = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    limits = (f"{sign} {field[name]:g}" for name, sign in bounds.items() if name in field)
    texts = {"array": f"list of {_range(items, linked)}" if items else "list", "object": "mapping"}
    texts |= {"boolean": "``true``, ``false``", "string": "text", "null": "``null``"}
    return f"{texts.get(kind, kind)} {', '.join(limits)}".strip()


def _text(description: str) -> str:
    """Plain text of a docstring as reStructuredText on one line: names in backticks are code."""
    parts = " ".join(description.split()).split("`")
    parts[::2] = (re.sub(r"([*|\\])|(?<=\w)(_)(?!\w)", r"\\\1\2", part) for part in parts[::2])
    return "``".join(parts)


def _add_table(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    if isinstance(thing, type) and issubclass(thing, BaseModel) and thing.model_fields:
        try:
            lines += ["", ".. rubric:: Fields", "", *table(thing.model_json_schema())]
        except PydanticInvalidForJsonSchema:
            return
