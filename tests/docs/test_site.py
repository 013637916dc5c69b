"""Tables of settings are those of the models, and search finds what a reader looks for."""

import importlib.util
import json

import pytest

from megalopta.config.model import Configuration

from .pages import DOCS


@pytest.fixture(scope="module")
def settings_page(tmp_path_factory):
    pytest.importorskip("sphinx")
    source = DOCS / "extensions" / "pydantic_fields.py"
    spec = importlib.util.spec_from_file_location("pydantic_fields", source)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    path = tmp_path_factory.mktemp("docs") / "configuration.rst"
    module.write_page(path)
    return path.read_text("utf-8")


def test_every_field_of_every_model_has_its_row(settings_page):
    schema = Configuration.model_json_schema()
    for model in (schema, *schema["$defs"].values()):
        for field in model.get("properties", {}):
            assert f"``{field}``" in settings_page


def test_a_row_gives_meaning_default_range_and_unit(settings_page):
    row = settings_page[settings_page.index("``height_spread``") :].splitlines()[:5]
    assert "Standard deviation of tree height" in row[1]
    assert [cell.strip(" -") for cell in row[2:4]] == ["``0.1``", "number ≥ 0, ≤ 0.3"]
    frame_rate = settings_page[settings_page.index("``frame_rate_hz``") :].splitlines()[4]
    assert frame_rate.strip(" -") == "Hz"


@pytest.mark.parametrize(
    ("words", "page"),
    [
        (["dead", "time"], "theory/dead-time"),
        (["n_2b"], "explanation/n2b"),
        (["epe"], "how-to/score"),
    ],
)
def test_search_finds(words, page):
    built = DOCS.parent / "build" / "docs" / "searchindex.js"
    if not built.exists():
        pytest.skip("no site is built: make docs")
    index = json.loads(built.read_text("utf-8").removeprefix("Search.setIndex(").removesuffix(")"))
    for word in words:
        entries = [index[terms].get(word, []) for terms in ("terms", "titleterms")]
        numbers = [n for each in entries for n in ([each] if isinstance(each, int) else each)]
        assert page in {index["docnames"][number] for number in numbers}
