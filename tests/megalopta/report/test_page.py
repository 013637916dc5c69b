"""The report of a dataset: complete, self-contained, and plain about what is missing or damaged."""

import re
import shutil

import pytest
from markupsafe import escape

from megalopta.config.model import Configuration, parse
from megalopta.core.errors import UserError, shell_command
from megalopta.dataset.store import open_sequence
from megalopta.report.page import write_report
from megalopta.report.source import select
from megalopta.stages.registry import STAGES
from megalopta.stages.run import run_all

from ..accessibility import needs_axe, violations
from ..small import agreeing, without

SECTIONS = ("light", "motion", "detectors", "photons", "made")
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
    methods: [BM, IIA, EMD]
    benchmark: {{sizes: [20, 30], fluxes_per_decade: 1, repeats: 2, flux_max: 1e8}}
    """,
    "test",
)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return run_all(tmp_path_factory.mktemp("data") / "small", CONFIGURATION)


@pytest.fixture
def copied(whole, tmp_path):
    """A dataset that may be changed, whose path has to be escaped."""
    root = shutil.copytree(whole, tmp_path / 'copy<cam> & "co"')
    return open_sequence(root)


@pytest.mark.slow
def test_a_report_is_complete_and_needs_nothing_from_outside(dataset):
    text = write_report(dataset).read_text("utf-8")
    names = re.findall(r'\sid="([^"]*)"', text)
    assert set(SECTIONS) <= set(names) and len(names) == len(set(names))
    assert "Run <code>" not in text
    assert 'class="score"' in text and "flow by IIA, " in text
    plain = re.sub(r"<(style|script|svg)[^>]*>.*?</\1>|<[^>]+>", " ", text, flags=re.DOTALL)
    words = plain.replace("\u202f", "").split()  # a number with thin spaces is one
    assert len(words) <= 1200 and len(text) < 4e6
    for words in (*CONFIGURATION.methods, SENSOR, "ideal", "0.5\xa0lux", "full\xa0moon"):
        assert words in text
    # 0.1 dark counts per pixel of 36 × 30 are 0.225 on a pixel of 24 × 20.
    assert "0.225 at 24 × 20 px, 0.1 at 36 × 30 px" in text
    for title in ("24 × 20 pixels, literal", "36 × 30 pixels, ratio"):
        assert re.search(f'<svg [^>]*aria-label="[^"]*{title} error', text)
    links = re.findall(r"""(?:\s(?:src|href|xlink:href)="|url\()([^")]*)""", text)
    assert links and all(link.startswith(("data:", "#")) for link in links)
    assert "://" not in text and "@import" not in text
    assert len(re.findall(r'<img [^>]*alt="[^"]|role="img" aria-label="[^"]', text)) > 12


@pytest.mark.slow
@needs_axe
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_keyboards_and_screen_readers_find_their_way(theme, dataset, tmp_path):
    assert violations(write_report(dataset), tmp_path, theme) == []


def test_missing_stages_leave_a_sentence_on_what_to_run(copied):
    text = write_report(without(copied.root, "sense")).read_text("utf-8")
    assert "copy&lt;cam&gt; &amp;" in text and "<cam>" not in text
    for verb in ("sense", "flow"):
        assert f"Run <code>{escape(shell_command(verb, copied.root))}" in text
    with pytest.raises(UserError, match="'render' is not finished .*run first: megalopta render"):
        write_report(without(copied.root, "render"))


@pytest.mark.parametrize("text", ["", "[1]", '[{"level": 1}]'])
@pytest.mark.parametrize("stage", ["flow", "benchmark", "render"])
def test_a_damaged_file_is_told_in_one_sentence(copied, refused, stage, text):
    path = copied.scene_record if stage == "render" else copied.result(f"{stage}.json")
    path.write_text(text)
    agreeing(copied.root)
    message = refused("report", copied.root)
    assert path.name in message and message.count("\n") == 1
    assert f"run: {shell_command(*STAGES[stage].command.split(), copied.root)}" in message


@pytest.mark.parametrize("frames", [2, 16, 1000])
@pytest.mark.parametrize(("width", "height"), [(36, 30), (1920, 1080)])
def test_what_is_shown_has_a_next_frame_and_stays_small(frames, width, height):
    configuration = Configuration.model_validate(
        {"trajectory": {"frames": frames}, "camera": {"width": width, "height": height}}
    )
    shown, step = select(configuration)
    assert shown[0] == 0 and shown[-1] <= frames - 2
    assert list(shown) == sorted(set(shown))
    columns, rows = -(-width // step), -(-height // step)
    assert max(columns, rows) <= 160
    films = len(configuration.sensors) * len(configuration.light_levels)
    assert columns * rows * len(shown) * films <= 8e6
