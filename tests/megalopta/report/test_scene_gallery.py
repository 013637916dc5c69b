"""The gallery: every scene it names can be built, and one is rendered in all lights."""

import re

import numpy as np
import pytest
from skimage.io import imread

from megalopta.config.model import Configuration
from megalopta.report import scene_gallery as gallery
from megalopta.scenes.build import OWN_SCENES
from megalopta.scenes.lighting.levels import LEVELS


@pytest.mark.parametrize("name", gallery.SCENES)
def test_every_scene_is_a_configuration(name):
    parts = gallery.SCENES[name]["scene"]
    scene = Configuration.model_validate(gallery.SCENES[name]).scene.model_dump()
    assert parts.items() <= scene.items()


def test_every_kind_of_scene_that_is_ours_is_shown():
    kinds = {each.model_fields["kind"].default for each in OWN_SCENES}
    shown = {parts["scene"]["kind"] for parts in gallery.SCENES.values()}
    assert shown == kinds - {"panorama"}  # a panorama is the user's own picture


def test_every_light_gives_a_view_and_as_many_photons_as_it_is_bright(tmp_path, monkeypatch):
    drawn = []
    draw = gallery.write_sheet

    def write_sheet(path, cells):
        drawn.extend(cells)
        draw(path, cells)

    monkeypatch.setattr(gallery, "write_sheet", write_sheet)
    page = gallery.write_gallery(tmp_path / "out", {"board": gallery.SCENES["board"]}, 4)
    assert [cell.level for cell in drawn] == list(LEVELS)
    # A board glows as brightly as its light, with one spectrum: photons per lux are the same, but
    # for shot noise (6 σ: a false alarm in 1e8 runs) and 1e-3 of the rendering.
    photons = np.array([cell.counts.sum(dtype=np.float64) for cell in drawn])
    lux = np.array([each.illuminance_lux for each in LEVELS.values()])
    per_lux = photons / lux / (photons[0] / lux[0])
    assert (np.abs(per_lux - 1) < 6 / np.sqrt(photons) + 1e-3).all()
    assert len(re.findall('src="data:image/png', page.read_text())) == 2 * len(LEVELS)
    assert imread(tmp_path / "out/gallery.png").std() > 30
