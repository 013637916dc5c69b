import json
import re
import shutil
from dataclasses import dataclass, field
from html.parser import HTMLParser
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from megalopta.config.model import Configuration, parse
from megalopta.config.yaml_model import to_yaml
from megalopta.core.errors import UserError, shell_command
from megalopta.dataset.store import open_sequence
from megalopta.report.page import write_report
from megalopta.report.source import select
from megalopta.stages.registry import STAGES
from megalopta.stages.run import run_all

from ..accessibility import needs_axe, violations
from ..small import agreeing, without

pytestmark = pytest.mark.slow

SECTIONS = ("light", "motion", "detectors", "photons", "words", "made")
SENSOR = "spad_cam-1"
CONFIGURATION = parse(
    f"""
    name: small_grating
    scene: {{kind: grating, cycles_per_frame: 3}}
    camera: {{width: 36, height: 30, fov_deg: 72}}
    trajectory: {{frames: 24, rotation_deg_s: 15}}
    render: {{samples_per_pixel: 4, max_depth: 2}}
    light_levels: [0.5, full_moon]
    sensors: [{{preset: spadcam, name: {SENSOR}}}, ideal]
    benchmark: {{sizes: [20, 30], fluxes_per_decade: 1, repeats: 2, flux_max: 1e8}}
    """,
    "test",
)
LEAN = parse(
    to_yaml(CONFIGURATION),
    "test",
    {
        "light_levels": "[0.5]",
        "sensors": f"{{preset: spadcam, name: {SENSOR}}}",
        "methods": "[BM, IIA, EMD]",
        "benchmark.sizes": "[20]",
        "benchmark.metrics": "[literal]",
        "benchmark.bits": "[2]",
    },
)
"""What has few charts, which take longest, for one thing that a page says."""


@dataclass
class Page(HTMLParser):
    """What the tests ask of a page."""

    tags: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    text: str = ""

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, {name: value or "" for name, value in attributes}))

    def handle_data(self, data):
        self.text += data

    def values(self, attribute):
        return [found[attribute] for _, found in self.tags if attribute in found]


def read(path: Path) -> Page:
    page = Page()
    page.feed(path.read_text("utf-8"))
    page.close()
    page.text = " ".join(page.text.split())
    return page


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return run_all(tmp_path_factory.mktemp("data") / "small", CONFIGURATION)


@pytest.fixture(scope="module")
def page(dataset):
    return read(write_report(dataset))


def rewrite(dataset, path, text):
    """Put other text into a file of a finished stage."""
    path.write_text(text)
    return agreeing(dataset.root)


@pytest.fixture(scope="module")
def lean(tmp_path_factory):
    return run_all(tmp_path_factory.mktemp("data") / "lean", LEAN)


@pytest.fixture
def copied_lean(lean, tmp_path):
    root = shutil.copytree(lean.root, tmp_path / 'copy<cam> & "co"')
    return open_sequence(root)


def test_a_report_has_all_its_sections(page):
    assert set(SECTIONS) <= set(page.values("id"))
    assert len(page.values("id")) == len(set(page.values("id")))
    assert "Run megalopta" not in page.text
    for name in (*CONFIGURATION.methods, SENSOR, "ideal", "0.5 lux", "full moon, 0.25 lux"):
        assert name in page.text
    # 0.1 dark counts per pixel of 36 × 30 are 0.225 on a pixel of 24 × 20.
    assert "0.23 at 24 × 20 px, 0.1 at 36 × 30 px" in page.text
    labels = [found["aria-label"] for tag, found in page.tags if tag == "svg"]
    for size, metric in product(("24 × 20", "36 × 30"), ("literal", "ratio")):
        assert any(f"{size} pixels, {metric} error" in label for label in labels)


def test_a_report_needs_nothing_from_outside(dataset, page):
    links = page.values("src") + page.values("href") + page.values("xlink:href")
    assert links
    assert all(link.startswith(("data:", "#")) for link in links)
    html = (dataset.root / "report.html").read_text("utf-8")
    assert "://" not in html
    assert "@import" not in html
    assert all(url.startswith(("data:", "#")) for url in re.findall(r"url\(([^)]*)\)", html))


def test_every_picture_says_what_it_shows(page):
    pictures = [found for tag, found in page.tags if tag == "img" or found.get("role") == "img"]
    assert len(pictures) > 50
    assert all(found.get("alt") or found.get("aria-label") for found in pictures)


@pytest.mark.parametrize(
    ("forgotten", "missing"),
    [("benchmark", {"benchmark photons"}), ("flow", {"flow"}), ("sense", {"sense", "flow"})],
)
def test_a_missing_stage_leaves_a_sentence_on_what_to_run(copied_lean, forgotten, missing):
    page = read(write_report(without(copied_lean.root, forgotten)))
    assert set(SECTIONS) <= set(page.values("id"))
    for verb in ("sense", "flow", "benchmark photons"):
        run = f"Run {shell_command(*verb.split(), copied_lean.root)}"
        assert (run in page.text) == (verb in missing)


DAMAGED = ("", "{}", "[1]", '[{"level": 1}]')


@pytest.mark.parametrize(
    ("stage", "name", "texts"),
    [
        ("flow", "flow.json", DAMAGED),
        ("benchmark", "benchmark.json", DAMAGED),
        ("render", "scene.json", [text for text in DAMAGED if text != "{}"]),  # may be empty
    ],
)
def test_a_damaged_file_is_told_in_one_sentence(copied_lean, refused, stage, name, texts):
    path = copied_lean.scene_record if stage == "render" else copied_lean.result(name)
    run = f"run: {shell_command(*STAGES[stage].command.split(), copied_lean.root)}"
    for text in texts:
        rewrite(copied_lean, path, text)
        told = refused("report", copied_lean.root)
        assert name in told, text
        assert run in told, text
        assert told.count("\n") == 1, text


@pytest.mark.parametrize("frames", [2, 3, 16, 1000])
@pytest.mark.parametrize(("width", "height"), [(36, 30), (640, 480), (1920, 1080)])
def test_what_is_shown_has_a_next_frame_and_stays_small(frames, width, height):
    configuration = Configuration.model_validate(
        {"trajectory": {"frames": frames}, "camera": {"width": width, "height": height}}
    )
    selection = select(configuration)
    assert selection.frames[0] == 0
    assert selection.frames[-1] <= frames - 2
    assert list(selection.frames) == sorted(set(selection.frames))
    shown = np.zeros((height, width))[:: selection.step, :: selection.step]
    assert max(shown.shape) <= 160
    films = len(configuration.sensors) * len(configuration.light_levels)
    assert shown.size * len(selection.frames) * films <= 8e6


@needs_axe
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_keyboards_and_screen_readers_find_their_way(theme, dataset, tmp_path):
    assert violations(write_report(dataset), tmp_path, theme) == []


def test_the_path_of_a_dataset_is_escaped(copied_lean):
    path = write_report(without(copied_lean.root, "benchmark"))
    assert "copy&lt;cam&gt; &amp;" in path.read_text("utf-8")
    page = read(path)
    assert str(copied_lean.root) in page.text
    assert all(tag != "cam" for tag, _ in page.tags)


def test_a_dataset_without_frames_is_refused(copied_lean):
    with pytest.raises(UserError, match="'render' is not finished .*run first: megalopta render"):
        write_report(without(copied_lean.root, "render"))


def test_a_missing_record_is_told_with_its_detector_sensor_and_light(copied_lean):
    records = json.loads(copied_lean.result("flow.json").read_text())
    kept = [each for each in records if each["method"] != "EMD"]
    changed = rewrite(copied_lean, copied_lean.result("flow.json"), json.dumps(kept))
    with pytest.raises(UserError, match=rf"lacks the errors of EMD on {SENSOR} at 0\.5lux"):
        write_report(changed)
