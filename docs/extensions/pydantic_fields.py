"""Fields of configurations as tables, made of the models: meaning, default, range and unit.

A page of all that a YAML file can hold, and a table below every model of the reference.
"""

import re
from collections.abc import Iterator, Mapping
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
# What a field's name ends in, longest first, and its unit.
UNITS = {
    **{"hz_um2": "Hz/µm²", "m_s2": "m/s²", "m_s": "m/s", "deg_s": "°/s", "v_s": "V/s"},
    **{"v_per_k": "V/K", "per_ha": "1/ha", "per_m2": "1/m²", "celsius": "°C", "lux": "lux"},
    **{"deg": "°", "nm": "nm", "um": "µm", "mm": "mm", "hz": "Hz", "ohm": "Ω", "db": "dB"},
    **{"px": "px", "a": "A", "f": "F", "k": "K", "m": "m", "s": "s", "v": "V"},
}
IN_WORDS = re.compile(
    r"\((?:[^()]* in )?(px|1|Hz|s|m|m/s|lux|degrees|count|V|K|rad|cycles)\b[^()]*\)"
)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the page before pages are read, and add the tables to the reference."""
    app.connect("builder-inited", lambda app: write_page(Path(app.srcdir) / PAGE))
    app.connect("autodoc-process-docstring", _add_table, priority=400)  # before numpydoc
    app.connect("autodoc-skip-member", _skip_member)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write_page(path: Path) -> None:
    """Write every model that a configuration can hold, each below those that name it."""
    lines = [
        *_title("Settings", "="),
        "A setting is a key of the YAML file and an option of the command line, named by its "
        "path: ``scene: {trees: 300}`` and ``--scene.trees 300``. The tables come from the "
        "program's own models. The program also checks bounds that only the text states. It "
        "refuses a wrong value in one sentence.",
        "",
    ]
    seen: set[str] = set()
    for model, what in ROOTS:
        schema = model.model_json_schema()
        found = dict(_reached(schema))
        lines += [f".. _setting-{model.__name__}:", "", *_title(model.__name__, "-"), what, ""]
        lines += table(schema, set(found) | seen)
        for name, place in found.items():
            if name not in seen:
                part = schema["$defs"][name]
                lines += [f".. _setting-{name}:", "", *_title(name, "~")]
                lines += [f"``{place}`` — {_text(part.get('description', ''))}", ""]
                lines += table(part, set(found) | seen)
        seen |= set(found)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines), "utf-8")


def table(schema: Schema, linked: set[str] = frozenset()) -> list[str]:
    """Lines of a table of the fields of one model; models in `linked` have a section."""
    if not schema.get("properties"):
        return []
    lines = [".. list-table::", "   :header-rows: 1", "   :class: settings", ""]
    rows = [("Field", "Meaning", "Default", "Range", "Unit")]
    for name, field in schema["properties"].items():
        meaning = _text(field.get("description", ""))
        rows.append(
            (f"``{name}``", meaning, _default(field), _range(field, linked), _unit(name, field))
        )
    for row in rows:
        lines += [f"   {'* -' if i == 0 else '  -'} {cell}".rstrip() for i, cell in enumerate(row)]
    return [*lines, ""]


def _reached(schema: Schema) -> Iterator[tuple[str, str]]:
    """Names of the models within a schema, each with the path at which it is first found."""
    found: set[str] = set()
    waiting = [("", schema)]
    while waiting:
        path, part = waiting.pop(0)
        for name, field in part.get("properties", {}).items():
            place = f"{path}.{name}" if path else name
            for inner in _references(field):
                if inner not in found:
                    found.add(inner)
                    waiting.append((place, schema["$defs"][inner]))
                    yield inner, place


def _references(field: Any) -> Iterator[str]:
    if isinstance(field, Mapping):
        if "$ref" in field:
            yield field["$ref"].rpartition("/")[2]
        for key, value in field.items():
            if key not in ("default", "discriminator"):
                yield from _references(value)
    elif isinstance(field, list):
        for each in field:
            yield from _references(each)


def _default(field: Schema) -> str:
    if "default" not in field:
        return "—"
    value = field["default"]
    if (isinstance(value, Mapping) and "$ref" in field) or any(True for _ in _references(field)):
        if value and isinstance(value, Mapping) and "kind" in value:
            return f"``{value['kind']}``"
        if isinstance(value, list):
            names = [each.get("name", "…") for each in value if isinstance(each, Mapping)]
            return f"``[{', '.join(names)}]``"
        return "as below" if value is not None else "``null``"
    text = strict_yaml.dump(value, default_flow_style=True, width=10_000)
    text = text.strip().removesuffix("...").strip()
    return f"``{text}``" if len(text) <= 120 else f"``{text[:117]}…``"


def _range(field: Schema, linked: set[str]) -> str:
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return f":ref:`{name} <setting-{name}>`" if name in linked else name
    for key in ("anyOf", "oneOf"):
        if key in field:
            parts = [_range(each, linked) for each in field[key] if each.get("type") != "null"]
            is_optional = any(each.get("type") == "null" for each in field[key])
            return " or ".join(dict.fromkeys(parts)) + (" or ``null``" if is_optional else "")
    if "const" in field:
        return f"``{field['const']}``"
    if "enum" in field:
        return ", ".join(f"``{each}``" for each in field["enum"])
    kind = field.get("type")
    if kind == "array":
        return _list_range(field, linked)
    if kind == "object":
        inner = field.get("additionalProperties")
        return f"mapping to {_range(inner, linked)}" if isinstance(inner, Mapping) else "mapping"
    if kind in ("number", "integer"):
        return " ".join(filter(None, (kind, _bounds(field))))
    return {"boolean": "``true``, ``false``", "string": "text"}.get(kind or "", kind or "")


def _list_range(field: Schema, linked: set[str]) -> str:
    if "prefixItems" in field:
        inner = ", ".join(_range(each, linked) for each in field["prefixItems"])
        return f"[{inner}]"
    least = field.get("minItems")
    items = field.get("items", {})
    inner = _range(items, linked) if items else "anything"
    return f"list of {inner}" + (f", at least {least}" if least else "")


def _bounds(field: Schema) -> str:
    low = "≥ " if "minimum" in field else "> "
    high = "≤ " if "maximum" in field else "< "
    least = field.get("minimum", field.get("exclusiveMinimum"))
    most = field.get("maximum", field.get("exclusiveMaximum"))
    return ", ".join(f"{sign}{n:g}" for sign, n in ((low, least), (high, most)) if n is not None)


def _unit(name: str, field: Schema) -> str:
    for ending, unit in UNITS.items():
        if name.endswith(f"_{ending}") or (name == ending and len(ending) > 2):
            return unit
    in_words = IN_WORDS.search(field.get("description", ""))
    return in_words[1] if in_words and in_words[1] not in ("1", "count") else ""


def _text(description: str) -> str:
    """Plain text of a docstring as reStructuredText on one line: names in backticks are code."""
    parts = " ".join(description.split()).split("`")
    escaped = [re.sub(r"([*|\\])|(?<=\w)(_)(?!\w)", r"\\\1\2", part) for part in parts[::2]]
    code = [f"``{part}``" for part in parts[1::2]]
    return "".join(a + b for a, b in zip(escaped, [*code, ""], strict=True))


def _title(text: str, line: str) -> list[str]:
    return [text, line * len(text), ""]


def _is_model(thing: Any) -> bool:
    return isinstance(thing, type) and issubclass(thing, BaseModel)


def _add_table(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    if what == "class" and _is_model(thing) and thing.model_fields:
        try:
            rows = table(thing.model_json_schema())
        except PydanticInvalidForJsonSchema:
            return
        lines += ["", ".. rubric:: Fields", "", *rows]


def _skip_member(
    app: Sphinx, what: str, name: str, member: Any, skip: bool, options: Any
) -> bool | None:
    """Leave out what pydantic brings along."""
    return True if name.startswith("model_") else None
