"""Galleries of scenes, of larger views, and of their statistics."""

import csv
import re

import numpy as np
import pytest
from skimage.io import imread

from megalopta.config.model import Configuration
from megalopta.report import gallery
from megalopta.report.gallery import write_statistics, write_views
from megalopta.scenes.build import OWN_SCENES
from megalopta.scenes.forest.plants import PRESETS
from megalopta.scenes.lighting.levels import LEVELS


@pytest.mark.parametrize("name", gallery.SCENES)
def test_every_scene_is_a_configuration(name):
    parts = gallery.SCENES[name]["scene"]
    scene = Configuration.model_validate(gallery.SCENES[name]).scene.model_dump()
    assert parts.items() <= scene.items()


def test_every_kind_of_scene_that_is_ours_is_shown():
    kinds = {each.model_fields["kind"].default for each in OWN_SCENES}
    shown = {parts["scene"]["kind"] for parts in gallery.SCENES.values()}
    assert shown == kinds - {"panorama", "pictures", "meshes"}  # which are the user's own


def test_every_light_gives_a_view_and_as_many_photons_as_it_is_bright(tmp_path):
    page = gallery.write_gallery(tmp_path / "out", {"board": gallery.SCENES["board"]}, 4)
    drawn = list(gallery.cells_of("board", gallery.SCENES["board"], 4))
    assert [cell.level for cell in drawn] == list(LEVELS)
    # A board glows as brightly as its light, with one spectrum: photons per lux are the same, but
    # for shot noise (6 σ: a false alarm in 1e8 runs) and 1e-3 of the rendering.
    photons = np.array([cell.counts.sum(dtype=np.float64) for cell in drawn])
    lux = np.array([each.illuminance_lux for each in LEVELS.values()])
    per_lux = photons / lux / (photons[0] / lux[0])
    assert (np.abs(per_lux - 1) < 6 / np.sqrt(photons) + 1e-3).all()
    assert len(re.findall('src="data:image/png', page.read_text())) == 2 * len(LEVELS)
    assert imread(tmp_path / "out/gallery.png").std() > 30


@pytest.mark.parametrize("title", gallery.VIEWS)
def test_every_view_is_a_configuration(title):
    settings = gallery.configured("view", gallery.VIEWS[title], None, title)
    assert settings.light.sky == "natural"


def test_every_preset_is_shown():
    assert {parts["scene"]["preset"] for parts in gallery.VIEWS.values()} == set(PRESETS)


@pytest.mark.slow
def test_a_photograph_stands_beside_a_forest_in_its_light_and_counts_after_their_view(
    picture, tmp_path
):
    path = picture(np.random.default_rng(0).random((32, 64, 3)))
    small = {"camera": {"width": 36, "height": 24}, "scene": {"kind": "grating"}}
    counted = {**small, "sensors": [{"preset": "ideal", "exposure_s": 0.1}]}
    page = write_views(tmp_path / "out", path, {"A grating": counted}, 1).read_text()
    titles = re.findall("<figcaption>(.*)</figcaption>", page)
    assert titles[:3] == ["A photographed forest", "A clearing in its light", "A grating"]
    assert re.fullmatch(r"A grating: .* photons per pixel in 0\.1 s", titles[3])
    assert len(re.findall('src="data:image/png', page)) == 4
    assert imread(tmp_path / "out/views.jpg").std() > 30


def test_what_is_no_panorama_is_refused_before_anything_is_rendered(tmp_path, refused):
    for options, message in (
        (["--views", "--panorama", str(tmp_path / "none.hdr")], "cannot be read"),
        (["--views", "--statistics"], "give one"),
        (["--panorama", "x.hdr"], "--panorama needs --views or --statistics"),
    ):
        assert message in refused("gallery", *options, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_photograph_is_measured_beside_forests(picture, tmp_path):
    path = picture(np.random.default_rng(0).random((32, 64, 3)))
    paths = write_statistics(tmp_path / "out", [path], 9, ["open"], 24)
    assert [each.suffix for each in paths] == [".png", ".svg", ".csv", ".json"]
    photograph, forest, blurred = csv.DictReader(paths[2].read_text().splitlines())
    assert (photograph["scene"], forest["scene"]) == (path.stem, "open")
    assert blurred["scene"] == "open, blurred"
    assert float(blurred["gradient_contrast"]) < float(forest["gradient_contrast"])
    assert all(np.isfinite(float(value)) for value in list(photograph.values())[1:])
