import json
import re
import shutil
import subprocess
from dataclasses import dataclass, field
from html import escape
from html.parser import HTMLParser
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import zarr

from megalopta.cli import main as cli
from megalopta.config.model import Configuration, load
from megalopta.core.errors import UserError
from megalopta.dataset.store import Dataset
from megalopta.report import page as report_page
from megalopta.report.page import write_report
from megalopta.report.source import Report, read_benchmark, read_records, select
from megalopta.sensor import PRESETS
from megalopta.sensor.spad.order import active_effects
from megalopta.stages.flow import responses_path
from megalopta.stages.ledger import Ledger
from megalopta.stages.pipeline import run_all, run_stage
from megalopta.stages.registry import STAGES

from ..accessibility import needs_axe, violations

pytestmark = pytest.mark.slow

SECTIONS = ("light", "motion", "detectors", "photons", "words", "made")
SENSOR = "spad_cam-1"
CONFIGURATION = Configuration.model_validate(
    {
        "name": "small_grating",
        "scene": {"kind": "grating", "cycles_per_frame": 3},
        "camera": {"width": 36, "height": 30, "fov_deg": 72},
        "trajectory": {"frames": 24, "rotation_deg_s": 15},
        "render": {"samples_per_pixel": 4, "max_depth": 2},
        "light_levels": [0.5, "full_moon"],
        "sensors": [{"preset": "spadcam", "name": SENSOR}, "ideal"],
        "benchmark": {"sizes": [20, 30], "fluxes_per_decade": 1, "repeats": 2, "flux_max": 1e8},
    }
)

LEAN = Configuration.model_validate(
    {
        **CONFIGURATION.model_dump(mode="json"),
        "light_levels": [0.5],
        "sensors": [{"preset": "spadcam", "name": SENSOR}],
        "methods": ["BM", "IIA", "EMD"],
        "benchmark": {
            **CONFIGURATION.benchmark.model_dump(mode="json"),
            "sizes": [20],
            "metrics": ["literal"],
            "bits": [2],
        },
    }
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


def rewrite(dataset, stage, path, text):
    """Put other text into a file of a finished stage."""
    path.write_text(text)
    Ledger(dataset).finish(stage)


@pytest.fixture(scope="module")
def lean(tmp_path_factory):
    return run_all(tmp_path_factory.mktemp("data") / "lean", LEAN)


def copy_of(dataset, folder):
    root = folder / 'copy<cam> & "co"'
    shutil.copytree(dataset.root, root)
    return Dataset(root, dataset.configuration)


@pytest.fixture
def copied(dataset, tmp_path):
    return copy_of(dataset, tmp_path)


@pytest.fixture
def copied_lean(lean, tmp_path):
    return copy_of(lean, tmp_path)


def test_a_report_has_all_its_sections(page):
    assert set(SECTIONS) <= set(page.values("id"))
    assert len(page.values("id")) == len(set(page.values("id")))
    assert "To have it here" not in page.text
    for name in (*CONFIGURATION.methods, SENSOR, "ideal", "0.5 lux", "full moon, 0.25 lux"):
        assert name in page.text
    # 0.1 dark counts per pixel of 36 × 30 are 0.225 on a pixel of 24 × 20.
    assert "0.23 at 24 × 20 px, 0.1 at 36 × 30 px" in page.text
    labels = [found["aria-label"] for tag, found in page.tags if tag == "svg"]
    for size, metric in product(("24 × 20", "36 × 30"), ("literal", "ratio")):
        assert any(f"{size} pixels, {metric} error" in label for label in labels)


def test_a_report_says_what_each_effect_of_a_sensor_does(page):
    sensor = PRESETS["spadcam"]
    names = active_effects(sensor)
    assert names
    for name in names:
        assert getattr(sensor, name).statement in page.text


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


def test_the_path_of_a_dataset_is_escaped(copied_lean):
    Ledger(copied_lean).forget("benchmark")
    path = write_report(copied_lean)
    assert "copy&lt;cam&gt; &amp;" in path.read_text("utf-8")
    page = read(path)
    assert str(copied_lean.root) in page.text
    assert all(tag != "cam" for tag, _ in page.tags)


def test_every_response_and_every_exposure_is_pictured(page):
    alternatives = set(page.values("alt"))
    labels = set(page.values("aria-label"))
    for level in ("0.5\u00a0lux", "full\u00a0moon"):
        assert f"Counts of {SENSOR} at {level}" in labels
        for method in CONFIGURATION.methods:
            for kind in ("noise-free", "from counts"):
                assert any(each.startswith(f"{method}, {level}, {kind}") for each in alternatives)


def test_what_the_device_and_the_normalization_do_is_shown(tmp_path):
    benchmark = LEAN.benchmark.model_copy(update={"both_normalizations": True})
    changed = LEAN.model_copy(update={"correct": True, "benchmark": benchmark})
    shown = read(write_report(run_all(tmp_path / "costs", changed)))
    for form in ("raw", "corrected", "perfect"):
        assert f"Frame of {SENSOR} at 0.5\N{NO-BREAK SPACE}lux, {form}" in shown.values("alt")
    for name in ("against itself", "raw against perfect", "corrected against perfect"):
        assert name in shown.text
    assert f"Noise, device and correction on {SENSOR}" in shown.values("aria-label")
    for name in ("every frame", "the mean frame"):
        assert f"24 × 20, {name}" in shown.text


@pytest.mark.parametrize(
    ("forgotten", "missing"),
    [("benchmark", {"benchmark photons"}), ("flow", {"flow"}), ("sense", {"sense", "flow"})],
)
def test_a_missing_stage_leaves_a_sentence_on_what_to_run(copied_lean, forgotten, missing):
    Ledger(copied_lean).forget(forgotten)
    page = read(write_report(copied_lean))
    assert set(SECTIONS) <= set(page.values("id"))
    for verb in ("sense", "flow", "benchmark photons"):
        assert (f"run megalopta {verb} {copied_lean.root}" in page.text) == (verb in missing)


def test_a_dataset_without_frames_is_refused(copied):
    Ledger(copied).forget("render")
    with pytest.raises(UserError, match="'render' is not finished .*run first: megalopta render"):
        write_report(copied)


DAMAGED = ("", "{", "{}", "[]", "[1]", "null", '"x"', "NaN", '[{"level": 1}]')


@pytest.mark.parametrize(
    ("stage", "name", "texts"),
    [
        ("flow", "flow.json", DAMAGED),
        ("benchmark", "benchmark.json", DAMAGED),
        ("render", "scene.json", [text for text in DAMAGED if text != "{}"]),  # may be empty
    ],
)
def test_a_damaged_file_is_told_in_one_sentence(copied_lean, capsys, stage, name, texts):
    path = copied_lean.scene_record if stage == "render" else copied_lean.result(name)
    for text in texts:
        rewrite(copied_lean, stage, path, text)
        with pytest.raises(SystemExit) as end:
            cli.main(["report", str(copied_lean.root)])
        assert end.value.code == 2, text
        told = capsys.readouterr().err
        assert name in told, text
        assert f"run: megalopta {STAGES[stage].command} {copied_lean.root}" in told, text
        assert told.count("\n") == 1, text


def test_what_the_stages_wrote_is_read_back_whole(dataset):
    written = json.loads(dataset.result("flow.json").read_text())
    records = read_records(dataset)
    assert [each.model_dump(mode="json", exclude_unset=True) for each in records] == written
    written = json.loads(dataset.result("benchmark.json").read_text())
    assert json.loads(json.dumps(read_benchmark(dataset).to_dict())) == written


def test_a_missing_record_is_told_with_its_detector_sensor_and_light(copied):
    records = json.loads(copied.result("flow.json").read_text())
    kept = [each for each in records if (each["method"], each["level"]) != ("NDS", 0.5)]
    rewrite(copied, "flow", copied.result("flow.json"), json.dumps(kept))
    with pytest.raises(UserError, match=rf"lacks the errors of NDS on {SENSOR} at 0\.5lux"):
        write_report(copied)


def test_a_response_of_another_shape_is_refused(copied):
    path = responses_path(copied, CONFIGURATION.sensors[0], 0.5)
    group = zarr.open_group(path, mode="a")
    del group["BM"]
    group.create_array("BM", data=np.zeros((2, 1, 1, 2), np.float32))
    Ledger(copied).finish("flow")
    with pytest.raises(UserError, match=r"zarr cannot be read .*\(2, 1, 1, 2\).*--redo"):
        write_report(copied)


def test_a_picture_without_motion_says_so_at_its_own_light_level(copied):
    path = responses_path(copied, CONFIGURATION.sensors[1], "full_moon")
    zarr.open_group(path, mode="a")["BM-ideal"][:] = 0
    Ledger(copied).finish("flow")
    page = read(write_report(copied))
    blank = "BM, full\u00a0moon, noise-free: no motion found"
    assert blank in page.values("alt")
    assert "BM, 0.5\u00a0lux, noise-free" in page.values("alt")
    told = [each for each in page.values("alt") if each.endswith(("found", "no response"))]
    notes = page.text.count("no motion found") + page.text.count("no response")
    assert notes >= len(told)  # on the pictures, too


@pytest.fixture(scope="module")
def rolling(tmp_path_factory):
    settings = load(
        "grating",
        {
            "camera.width": "36",
            "camera.height": "30",
            "trajectory.frames": "4",
            "trajectory.rotation_deg_s": "30",
            "shutter.readout_s": "0.1",
            "render.samples_per_pixel": "4",
            "methods": "[BM]",
        },
    )
    root = tmp_path_factory.mktemp("rolling") / "data"
    for stage in ("render", "sense", "flow"):
        dataset = run_stage(root, settings, stage)
    return dataset


def test_a_report_shows_the_frames_and_the_motion_that_sensors_saw(rolling):
    text = write_report(rolling).read_text("utf-8")
    assert "read out row by row within 0.1 s" in text
    assert "Every frame is rendered at one instant" not in text
    # Damage is named, also of the frames of one instant, which nobody sees.
    rolling.radiance(1).write_bytes(bytes(rolling.radiance(1).stat().st_size))
    with pytest.raises(UserError, match=r"frame_0002\.exr is missing or damaged"):
        write_report(rolling)


def test_a_failed_report_leaves_the_old_one(dataset, page, monkeypatch):
    old = (dataset.root / "report.html").read_bytes()

    def fail(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(report_page, "page", fail)
    with pytest.raises(KeyboardInterrupt):
        write_report(dataset)
    assert (dataset.root / "report.html").read_bytes() == old
    assert not list(dataset.root.glob(".part*"))


def test_an_ideal_sensor_detects_every_photon_with_the_noise_of_counting(dataset):
    """Without dark counts and dead time the signal-to-noise ratio of N counts is √N."""
    budgets = [each.budget for each in Report(dataset).exposures]
    ideal = [budget for budget in budgets if budget.sensor.name == "ideal"]
    for budget in ideal:
        assert budget.dark == 0
        assert budget.detected == pytest.approx(budget.photons, rel=1e-6)
        assert budget.expected == pytest.approx(budget.photons, rel=0.05)  # over all frames
    # Levels of 0.5 and 0.25 lux: half the photons.
    assert ideal[0].photons == pytest.approx(2 * ideal[1].photons, rel=1e-5)
    assert budgets[0].photons_per_frame == pytest.approx(36 * 30 * budgets[0].detected, rel=1e-9)
    ratio = np.array(ideal[0].signal_to_noise) / ideal[1].signal_to_noise
    np.testing.assert_allclose(ratio, np.sqrt(2), rtol=1e-5)


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
    shown = selection.pixels(np.zeros((height, width)))
    assert max(shown.shape) <= 160
    films = len(configuration.sensors) * len(configuration.light_levels)
    assert shown.size * len(selection.frames) * films <= 8e6


@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
def test_a_browser_shows_it_without_errors_and_within_400_pixels(dataset, page, tmp_path):
    html = (dataset.root / "report.html").read_text("utf-8")
    wrapper = tmp_path / "wrapper.html"
    wrapper.write_text(
        f"""<iframe width="400" height="800" srcdoc="{escape(html)}" onload="
        const page = this.contentDocument, root = page.documentElement;
        const slider = page.querySelector('.transport input');
        slider.value = 3;
        slider.dispatchEvent(new Event('input'));
        const told = [...page.querySelectorAll('.transport output')].map(each => each.textContent);
        const nav = page.querySelector('nav'), tiles = [...page.querySelectorAll('.facts div')];
        root.style.scrollBehavior = 'auto';
        page.querySelector('#photons').scrollIntoView();
        const reachable = nav.getBoundingClientRect().top === 0 && this.contentWindow.scrollY > 0;
        const [before, last] = tiles.slice(-2).map(each => each.offsetTop);
        const overflow = Math.max(root.scrollWidth, page.body.scrollWidth) - root.clientWidth;
        document.body.insertAdjacentHTML('beforeend',
          `<p>nav ${{reachable}} alone ${{before !== last}} overflow ${{overflow}} frame ${{root.style.getPropertyValue('--frame')}} ${{told}}</p>`);
        "></iframe>""",
        encoding="utf-8",
    )
    chromium = subprocess.run(
        [
            *("chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic"),
            *("--no-first-run", "--disable-background-networking", "--disable-component-update"),
            *("--disable-sync", "--enable-logging=stderr", "--v=0", "--dump-dom"),
            f"--user-data-dir={tmp_path / 'profile'}",
            wrapper.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert "CONSOLE" not in chromium.stderr
    answer = chromium.stdout.rpartition("<p>")[2]
    assert answer.startswith("nav true alone false overflow 0 frame 3 frame 4 ·")
    assert answer.count("frame 4 · 0.30 s") == 3


@needs_axe
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_keyboards_and_screen_readers_find_their_way(theme, dataset, tmp_path):
    assert violations(write_report(dataset), tmp_path, theme) == []
