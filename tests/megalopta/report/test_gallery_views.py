"""Larger views: each is a configuration, and a photograph stands beside a forest in its light."""

import re

import numpy as np
import pytest
from skimage.io import imread

from megalopta.cli import main
from megalopta.config.model import Configuration
from megalopta.report import gallery_views as views
from megalopta.report.gallery_views import write_views
from megalopta.scenes.forest.plants import PRESETS


@pytest.mark.parametrize("view", views.VIEWS, ids=lambda view: view.title)
def test_every_view_is_a_configuration(view):
    settings = Configuration.model_validate({"camera": {"width": 9, "height": 6}, **view.parts})
    assert settings.light.sky == "natural"


def test_every_preset_is_shown():
    assert {view.parts["scene"]["preset"] for view in views.VIEWS} == set(PRESETS)


@pytest.mark.slow
def test_a_photograph_stands_beside_a_forest_in_its_light_and_counts_after_their_view(
    picture, tmp_path
):
    path = picture(np.random.default_rng(0).random((32, 64, 3)))
    small = {"camera": {"width": 36, "height": 24}, "scene": {"kind": "grating"}}
    counted = views.GalleryView("A grating", small, exposure_s=0.1)
    page = write_views(tmp_path / "out", path, (counted,), 1).read_text()
    titles = re.findall("<figcaption>(.*)</figcaption>", page)
    assert titles[:3] == ["A photographed forest", "A clearing in its light", "A grating"]
    assert re.fullmatch(r"A grating: .* photons per pixel in 0\.1 s", titles[3])
    assert len(re.findall('src="data:image/png', page)) == 4
    assert imread(tmp_path / "out/views.jpg").std() > 30


def test_what_is_no_panorama_is_refused_before_anything_is_rendered(tmp_path, capsys):
    (tmp_path / "bad.hdr").write_text("nothing")
    for options, message in (
        (["--panorama", "x.hdr"], "--panorama goes with --views"),
        (["--views", "--panorama", str(tmp_path / "none.hdr")], "cannot be read"),
        (["--views", "--panorama", str(tmp_path / "bad.hdr")], "cannot be read as a picture"),
    ):
        with pytest.raises(SystemExit, match="2"):
            main.main(["gallery", *options, "--out", str(tmp_path / "out")])
        assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
