"""`megalopta view`: a film and a page of what there is."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image

from megalopta.cli import main
from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.report.view import ViewOptions, view

from ..accessibility import needs_axe, needs_chromium, violations
from ..small import made, small

SMALL = small(32, 24, 4, sensors="spadcam, ideal", levels="starlight, 10") | {
    "render.bands_nm": "[[450, 550], [550, 650]]",
    "scene.cycles_per_frame": "4",
}


@pytest.fixture(scope="module")
def exposed(tmp_path_factory):
    """A dataset of two sensors at two light levels, in which no motion was looked for yet."""
    return made(tmp_path_factory.mktemp("exposed") / "data", load("grating", SMALL)).root


@pytest.fixture(scope="module")
def page(exposed, tmp_path_factory):
    out = tmp_path_factory.mktemp("seen")
    view(exposed, out)
    return out / "view.html"


def panels(path):
    """Labels of the films of a page, and whether each is shown at first."""
    text = path.read_text("utf-8")
    found = re.findall(
        r'(<div [^>]*>)\s*<figure><div class="film" role="img" aria-label="([^":]+)', text
    )
    return [(label, " hidden" not in box) for box, label in found]


def state(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


@pytest.mark.slow
def test_one_sequence_of_many_is_viewed_by_its_path(small_dataset, tmp_path):
    written = view(small_dataset / "000001", tmp_path / "out")
    assert {path.name for path in written} >= {"film.gif", "view.html"}
    with pytest.raises(UserError, match="no sequence 'x'"):
        view(small_dataset / "x", tmp_path / "out")


def test_light_counts_flow_and_truth_stand_side_by_side(whole, tmp_path):
    before = state(whole)
    written = view(whole, tmp_path / "out")
    assert {each.name for each in written} >= {"film.gif", "view.html"}
    assert [label for label, _ in panels(tmp_path / "out" / "view.html")] in (
        ["light", "counts", "flow by BM", "true flow"],
        ["light", "counts", "flow by LK", "true flow"],
    )
    with Image.open(tmp_path / "out" / "film.gif") as film:
        assert film.n_frames == 3  # the fourth has no successor
    text = (tmp_path / "out" / "view.html").read_text("utf-8")
    assert "Page and film show all 3 frames with a next one." in text
    assert state(whole) == before


def test_a_page_shows_the_first_sensor_in_the_brightest_light(page):
    assert [label for label, _ in panels(page)] == ["light", *["counts"] * 4, "true flow"]
    text = page.read_text("utf-8")
    shown = re.findall(r'class="chosen" data-sensor="(\d)" data-level="(\d)">', text)
    assert shown == [("0", "1")]
    texts = json.loads(re.search(r'data-texts="([^"]+)"', text)[1].replace("&#34;", '"'))
    assert texts == ["starlight", "10\xa0lux"]
    assert re.findall(r"<option value=.\d.>(\w+)", text) == ["spadcam", "ideal"]


def test_a_stage_of_another_configuration_is_told_and_not_shown(exposed, tmp_path, capsys):
    root = tmp_path / "data"
    shutil.copytree(exposed, root)
    (path,) = (root / "sequences").glob("*.json")
    record = json.loads(path.read_text("utf-8"))
    record["configuration"]["light_levels"] = ["twilight"]
    path.write_text(json.dumps(record))
    view(root, tmp_path / "out", ViewOptions(summed=2))
    assert "stage 'sense' is not finished with this configuration" in capsys.readouterr().err
    assert [label for label, _ in panels(tmp_path / "out" / "view.html")] == ["light", "true flow"]
    assert "sums of 2 frames" not in (tmp_path / "out" / "view.html").read_text("utf-8")


@needs_chromium
def test_sliders_choose_light_sensor_and_time(page, tmp_path):
    """As a browser runs it: the darkest light, the second sensor, the last moment."""
    script = """<script>
      const set = (at, value) => {
        at.value = value;
        at.dispatchEvent(new Event("input", {bubbles: true}));
      };
      set(document.querySelector("[data-choice=level]"), 0);
      set(document.querySelector("[data-choice=sensor]"), 1);
      set(document.querySelector(".transport input"), 2);
      const seen = [...document.querySelectorAll(".chosen:not([hidden])")];
      document.body.insertAdjacentHTML("beforeend", `<pre id="seen">${JSON.stringify([
        seen.map(each => [each.dataset.sensor, each.dataset.level]),
        document.documentElement.style.getPropertyValue("--frame"),
        document.querySelector(".transport output").textContent,
        document.querySelector(".choices output").textContent])}</pre>`);
    </script></body>"""
    copy = tmp_path / "page.html"
    copy.write_text(page.read_text("utf-8").replace("</body>", script), "utf-8")
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--dump-dom")
    line = ["chromium", *options, f"--user-data-dir={tmp_path / 'profile'}", copy.as_uri()]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120, check=True)
    told = re.search(r'<pre id="seen">(.*?)</pre>', done.stdout)[1].replace("&nbsp;", " ")
    assert json.loads(told) == [[["1", "0"]], "2", "frame 3 · 0.20 s", "starlight"]


def test_bursts_of_a_dataset_are_shown_at_their_rate_by_a_sampling_that_is_told(tmp_path):
    """Four frames of 30 × 24 px at 10 Hz, with 30 binary frames to each."""
    wanted = {"camera.width": "30", "products": "[counts, burst_npy]", "sub_frames": "2"}
    settings = load("grating", SMALL | wanted | {"burst_hz": "300", "sensors": "[ideal]"})
    root, page = made(tmp_path / "data", settings).root, tmp_path / "out" / "view.html"
    view(root, page.parent)
    labels = [label for label, _ in panels(page)]
    assert labels == ["light", "counts", "counts", "burst", "burst", "true flow"]
    text = page.read_text("utf-8")
    assert "4 frames of 30 × 24 pixels at 10 Hz, 30 binary frames in each at 300 Hz." in text
    assert "Of 90 frames, the page shows one in 2, the film all." in text
    view(next(root.glob("counts/*/*.burst.npy")), page.parent, ViewOptions(summed=2))
    assert "120 binary frames of 30 × 24 pixels at 300 Hz." in page.read_text("utf-8")


def test_of_pictures_the_flow_between_the_clean_ones_stands_in_for_the_true(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (24, 48), np.uint8)
    (tmp_path / "clip").mkdir()
    for number in range(4):
        Image.fromarray(noise[:, number : number + 32]).save(tmp_path / "clip" / f"{number}.png")
    words = ["--photons", "2", "--sensors", "[ideal]", "--out", str(tmp_path / "data")]
    main.main(["sense", str(tmp_path / "clip"), *words])
    view(tmp_path / "data", tmp_path / "out")
    shown = panels(tmp_path / "out" / "view.html")
    assert [label for label, _ in shown] == ["light", "counts", "flow of the clean pictures"]
    assert "true motion is unknown" in (tmp_path / "out" / "view.html").read_text("utf-8")


@needs_axe
@pytest.mark.slow
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_keyboards_and_screen_readers_find_their_way(theme, page, tmp_path):
    assert violations(page, tmp_path, theme) == []


def test_of_many_sequences_there_is_a_contact_sheet(small_dataset, tmp_path):
    before = state(small_dataset)
    assert view(small_dataset, tmp_path) == [tmp_path / "index.html"]
    assert (tmp_path / "index.html").read_text("utf-8").count("data:image/gif") == 3 * 4
    with pytest.raises(UserError, match="many sequences have no film; omit options, or view"):
        view(small_dataset, tmp_path, ViewOptions(summed=2))
    assert state(small_dataset) == before


def test_a_cube_of_packed_bits_is_shown_by_one_command(tmp_path, capsys):
    bits = np.random.default_rng(0).random((40, 16, 24)) < 0.3
    np.save(tmp_path / "burst.npy", np.packbits(bits, axis=-1))
    words = f"--format packed_npy --out {tmp_path / 'out'} --sum 4 --invert --fps 5"
    main.main(["view", str(tmp_path / "burst.npy"), *words.split()])
    assert str(tmp_path / "out" / "view.html") in capsys.readouterr().out.splitlines()
    text = (tmp_path / "out" / "view.html").read_text("utf-8")
    assert "40 binary frames of 24 × 16 pixels, at unknown times." in text
    assert "Page and film show all 10 sums of 4 frames." in text
    assert "frames 21 to 24" in text
    assert panels(tmp_path / "out" / "view.html") == [("detections", True)]
    with Image.open(tmp_path / "out" / "film.gif") as film:
        assert (film.n_frames, film.info["duration"]) == (10, 200)


def test_a_flat_field_is_gray_over_its_own_range_and_its_exposure_may_be_given(tmp_path):
    counts = np.random.default_rng(0).poisson(100.0, (40, 16, 24)).astype(np.uint16)
    np.save(tmp_path / "flat.npy", counts)
    main.main(["view", f"{tmp_path / 'flat.npy'}@2e7:1e-4", "--out", str(tmp_path / "out")])
    text = (tmp_path / "out" / "view.html").read_text("utf-8")
    assert "40 frames of 24 × 16 pixels at 10 kHz." in text
    black, white = map(int, re.search(r"black (\d+), white (\d+) counts", text).groups())
    # percentiles 1 and 95 of Poisson counts of mean 100; of 3072 readings, 2 counts are 6 σ
    assert abs(black - 77) <= 3 and abs(white - 117) <= 2
    view(tmp_path / "flat.npy", tmp_path / "out")
    assert "at unknown times" in (tmp_path / "out" / "view.html").read_text("utf-8")


def test_a_dataset_without_a_finished_sequence_says_what_to_run(small_copy, tmp_path):
    for record in (small_copy / "sequences").glob("*.json"):
        record.unlink()
    with pytest.raises(UserError, match="no finished sequence; run: megalopta "):
        view(small_copy, tmp_path / "out")
