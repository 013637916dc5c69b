"""Every page of a command as Chromium shows it: nothing is cut off, and axe finds nothing."""

import numpy as np
import pytest

from megalopta.benchmark import table
from megalopta.benchmark.curves import STILL
from megalopta.benchmark.design import design
from megalopta.benchmark.design_page import write_design
from megalopta.benchmark.ranking import Ranking, RankingFacts
from megalopta.benchmark.ranking_page import write_ranking
from megalopta.camera.calibration import calibrate_recordings
from megalopta.camera.comparison import CompareSettings, compare_captured
from megalopta.camera.sources import Beam, Source
from megalopta.dataset.store import open_sequence
from megalopta.flow.detectors.registry import METHODS
from megalopta.report.dataset_card import write_contact_sheet
from megalopta.report.page import write_report
from megalopta.report.style import METHOD_COLORS, method_style
from megalopta.report.view import view

from ..accessibility import cut_off, needs_axe, needs_chromium, violations


def ranking(methods, fluxes, groups):
    """Errors that differ by method and light, with six units."""
    rng, rows = np.random.default_rng(0), []
    clearest = {"BM": 10.0, "PF": 3.0, "DIS": 7.5, STILL: 20.0}
    for name in (*methods, STILL):
        for flux in fluxes:
            for metric in (table.MEAN, table.MEDIAN, table.FAR):
                for group in ("all", *groups):
                    for unit in range(6):
                        error = 1 + rng.random() / 9 + abs(clearest[name] - np.log10(flux))
                        rows.append((metric, name, flux, group, str(unit), 100 * error / 9, 100))
    facts = {
        "settings": {"methods": methods, "fluxes": fluxes},
        "sequences": ["a"] * 6,
        "frames": 48,
        "frame_px": 4096,
        "photons_per_lux_s": 1e9,
        "blocks": {"all": 600, **dict.fromkeys(groups, 300)},
    }
    return Ranking(RankingFacts.model_validate(facts), table.means(table.samples(rows)))


def device(folder):
    """Recordings of counts in the dark and under two lights, and the calibrated device file."""
    rng, sources = np.random.default_rng(1), []
    for name, light in (("dark", 0.0), ("dim", 1e5), ("bright", 4e6)):
        events_hz = 500 + 0.3 * light
        mean = 1e-3 * events_hz / (1 + 1e-7 * events_hz) * np.ones((400, 12, 16))
        np.save(folder / f"{name}.npy", rng.poisson(mean).astype(np.uint16))
        sources.append(Source(path=folder / f"{name}.npy", light=light, exposure_s=1e-3))
    calibrate_recordings(sources, folder / "device.yaml", beam=Beam(600.0), base="ideal")
    return sources


def ranking_page(folder, _):
    groups = ("visible", "occluded", "speed low", "parallax high")
    return write_ranking(folder, ranking(("BM", "PF", "DIS"), (1e3, 1e4, 1e5, 1e6, 1e8), groups))


def calibration_page(folder, _):
    device(folder)
    return folder / "device.html"


def comparison_page(folder, _):
    sources, out = device(folder), folder / "comparison.html"
    settings = CompareSettings(beam=Beam(600.0))
    dimmer = [one.model_copy(update={"light": 1.2 * one.light}) for one in sources[::-1]]
    assert "efficiency" in compare_captured(dimmer, folder / "device.yaml", out, settings)
    headings = out.read_text("utf-8").partition("again with the fitted efficiency")[2].split("<h3>")
    assert [part.split()[0] for part in headings[1:]] == ["Dark,", "120", "4.8"]
    return out


def design_page(folder, _):
    return write_design(folder, design("ideal", light_levels=["daylight", "starlight"]))


def report_page(_, request):
    return write_report(open_sequence(request.getfixturevalue("whole_copy")))


def view_page(folder, request):
    return view(request.getfixturevalue("whole"), folder)[-1]


def contact_sheet(folder, request):
    return write_contact_sheet(request.getfixturevalue("small_dataset"), 3, folder)


PAGES = (
    *(ranking_page, calibration_page, comparison_page, design_page),
    *(report_page, view_page, contact_sheet),
)


@needs_chromium
@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_nothing_is_wider_than_the_window(page, tmp_path, request):
    path = page(tmp_path, request)
    assert [cut_off(path, tmp_path, width_px) for width_px in (400, 1280)] == [[], []]


@needs_axe
@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_keyboards_and_screen_readers_find_their_way(page, tmp_path, request):
    assert violations(page(tmp_path, request), tmp_path, "light") == []


def test_a_ranking_says_who_is_first_at_which_light(tmp_path):
    text = ranking_page(tmp_path, None).read_text("utf-8")
    summary = text.partition('class="lead">')[2].partition("</p>")[0]
    assert summary.startswith("Lowest mean error: PF at 1000, 10\u202f000, 100\u202f000; DIS at")
    assert "photons per frame." in summary


def test_every_method_has_a_color_of_its_own():
    assert METHOD_COLORS.keys() == METHODS.keys()
    assert len(set(METHOD_COLORS.values())) == len(METHODS)
    assert {method_style(f"DIS{form}")["color"] for form in ("", " √", " tuned", " NLM")} == {
        METHOD_COLORS["DIS"]
    }
    own = [method_style(name, ("DIS √", "a:f", "b:g")) for name in ("a:f", "b:g")]
    assert own[0]["color"] == method_style("x:y", ("PF", "x:y"))["color"] != own[1]["color"]
    assert not {look["color"] for look in own} & {*METHOD_COLORS.values()}
