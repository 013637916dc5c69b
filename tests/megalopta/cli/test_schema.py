"""The JSON schemas accept what the program accepts, as an editor compares it."""

import re
import textwrap
from pathlib import Path

import pytest

from megalopta.cli.schema import schemas
from megalopta.core import strict_yaml

jsonschema = pytest.importorskip("jsonschema")

ROOT = Path(__file__).parents[3]
SCHEMAS = schemas()
FILES = {
    "configuration": (ROOT / "megalopta/config/presets").glob("*.yaml"),
    "sweep": (ROOT / "megalopta/reproduction/sweeps").glob("*.yaml"),
    "sensor": [ROOT / "docs/example_device/device.yaml", *ROOT.glob("docs/public_arrays/*.yaml")],
}
CAPTIONED = re.compile(r"^:caption: \S+\.yaml\n+(.*?)^```", re.DOTALL | re.MULTILINE)


def leaves(errors):
    """Place and message of the faults in every alternative."""
    for error in errors:
        yield f"{'/'.join(map(str, error.absolute_path))}: {error.message}"
        yield from leaves(error.context)


def faults(name, text):
    return [
        *leaves(jsonschema.Draft202012Validator(SCHEMAS[name]).iter_errors(strict_yaml.load(text)))
    ]


def name_of(keys):
    kinds = {"sequences": "plan", "trial": "sweep", "scene": "configuration", "name": "sensor"}
    return next((kind for key, kind in kinds.items() if key in keys), None)


def documented():
    for page in sorted((ROOT / "docs").rglob("*.md")):
        for text in CAPTIONED.findall(page.read_text("utf-8")):
            if name := name_of(strict_yaml.load(text)):
                yield pytest.param(name, text, id=f"{page.stem}-{name}")


SHIPPED = [
    pytest.param(name, path.read_text("utf-8"), id=path.stem)
    for name, paths in FILES.items()
    for path in paths
]


@pytest.mark.parametrize(("name", "text"), [*documented(), *SHIPPED])
def test_files_of_the_documentation_and_of_the_package_have_no_fault(name, text):
    assert not faults(name, text)


def test_the_plan_of_the_documentation_with_every_kind_of_range_has_no_fault():
    page = (ROOT / "docs/how-to/datasets.md").read_text("utf-8")
    (text,) = re.findall(r"^    sequences: 200.*?\n\n", page, re.DOTALL | re.MULTILINE)
    assert not faults("plan", textwrap.dedent(text))


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("plan", "sequences: many", "sequences: 'many' is not of type 'integer'"),
        ("plan", "sequencez: 3", "'sequencez' was unexpected"),
        ("plan", "scenes: [{preset: demo, camera: {widht: 3}}]", "scenes/0/camera: "),
        ("plan", "every: {camera: {width: {uniform: 3}}}", "every/camera/width/uniform: "),
        ("plan", "sensors: [{preset: ideal, pitch: 3}]", "'pitch' was unexpected"),
        ("sensor", "{preset: ideal, fill_factor: all}", "fill_factor: 'all' is not of type"),
        ("sensor", "dead_time: {kind: never}", "dead_time/kind: 'never' is not one of"),
        ("sweep", "trial: {velocity: 3}", "trial: "),
        ("configuration", "sensors: [{fill_factr: 1}]", "'fill_factr' was unexpected"),
    ],
)
def test_a_fault_is_found_where_it_is(name, text, fault):
    assert any(fault in line for line in faults(name, text))
