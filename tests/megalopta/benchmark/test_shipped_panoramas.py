"""The panoramas that come with the package: what they are, and that they are still what is grown."""

import io

import numpy as np
import pytest
from rich.console import Console

from megalopta.benchmark import panoramas
from megalopta.benchmark.panorama_recipes import NATURAL_PANORAMAS, RENDER_MODEL, render_panorama
from megalopta.benchmark.panoramas import (
    SHIPPED,
    natural_templates,
    panorama_file,
    write_template,
)
from megalopta.cli import main as cli
from megalopta.render import RenderNoise
from megalopta.verification import panoramas as check_panoramas, panoramas as checked_panoramas
from megalopta.verification.panoramas import LIMIT, compare, run_check_panoramas

RECIPE = NATURAL_PANORAMAS["open"]
NOISE = 0.05


def light(seed, noise=NOISE, brightness=3e-8):
    """A rendering (251, m, 1) of smooth random light, the same for every seed, but for noise."""
    rng, noisy = np.random.default_rng(1), np.random.default_rng(seed)
    scene = np.kron(rng.gamma(2, size=(32, 113)), np.ones((8, 8)))[:251, :900, np.newaxis]
    error = noise * scene.mean() * noisy.standard_normal(scene.shape)
    return (brightness * np.maximum(scene + error, 0)).astype(np.float32)


def noise_of(rms):
    return RenderNoise(4, rms, rms, (1.0,), ((rms**2,),))


@pytest.fixture
def shipped(tmp_path, monkeypatch):
    """File that ships a rendering of `light` for every forest; no other is there."""
    monkeypatch.setattr(panoramas, "SHIPPED", tmp_path)
    monkeypatch.setattr(check_panoramas, "SHIPPED", tmp_path)
    for name, recipe in NATURAL_PANORAMAS.items():
        write_template(tmp_path / f"{name}.exr", recipe, light(0), noise_of(NOISE))
    return tmp_path


def test_the_package_ships_all_forests_in_2_mb():
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) < 2e6
    for name, recipe in NATURAL_PANORAMAS.items():
        assert panorama_file(name, recipe) == SHIPPED / f"{name}.exr", "ship it anew"


def test_a_fresh_machine_renders_nothing(monkeypatch, tmp_path):
    monkeypatch.setattr(panoramas, "render_panorama", None)
    templates = natural_templates(tmp_path)
    assert list(tmp_path.iterdir()) == []
    for name, recipe in NATURAL_PANORAMAS.items():
        assert templates[name].shape == (251, recipe.camera.width)
        assert templates[name].mean() == pytest.approx(1, abs=1e-12)
        assert templates[name].min() > 0


def test_half_floats_of_night_round_by_less_than_a_two_thousandth(shipped):
    expected = light(0)[..., 0].astype(np.float64)
    found = natural_templates()["open"]
    np.testing.assert_allclose(found, expected / expected.mean(), rtol=2**-11)


@pytest.mark.parametrize("change", [{"seed": 1}, {"passes": 9}, {"eye_m": 1.7}])
def test_another_recipe_is_not_answered_with_the_shipped_file(shipped, tmp_path, change):
    other = RECIPE.model_copy(update=change)
    assert panorama_file("open", RECIPE, tmp_path).parent == shipped
    assert panorama_file("open", other, tmp_path).parent == tmp_path / "panoramas"


def test_a_raised_version_is_another_recipe(monkeypatch):
    before = RECIPE.sha256
    monkeypatch.setattr("megalopta.benchmark.panorama_recipes.RENDER_MODEL", RENDER_MODEL + 1)
    assert RECIPE.sha256 != before


def test_a_broken_shipped_file_is_rendered_again(shipped, tmp_path):
    (shipped / "open.exr").write_bytes(b"half a fi")
    assert panorama_file("open", RECIPE, tmp_path).parent == tmp_path / "panoramas"


def test_renderings_that_differ_by_noise_agree(shipped):
    found = compare(shipped / "open.exr", light(1), noise_of(NOISE))
    assert found.agrees
    # Of 225 900 pixels, the RMS is known to 0.15 %, that of 360 blocks to 3.7 %: five of these.
    assert found.pixels == pytest.approx(found.noise, rel=0.008)
    assert found.blocks * check_panoramas.BLOCK == pytest.approx(found.noise, rel=0.19)
    assert found.rounding < 0.01


def test_a_change_that_hides_in_the_noise_of_pixels_is_seen_in_blocks(shipped):
    changed = light(1)
    changed[:, :450] *= 1.01
    found = compare(shipped / "open.exr", changed, noise_of(NOISE))
    assert found.pixels < LIMIT * found.noise
    assert not found.agrees


def test_check_renders_all_writes_them_and_says_what_differs(shipped, tmp_path, monkeypatch):
    def render(recipe, after_pass):
        return light(1) * (1 + (recipe is RECIPE) * np.eye(251, 900)[..., None]), noise_of(NOISE)

    monkeypatch.setattr(check_panoramas, "render_panorama", render)
    (shipped / "dense.exr").unlink()
    text = io.StringIO()
    assert not run_check_panoramas(tmp_path / "new", Console(file=text, width=200))
    rows = {line.split()[1]: line for line in text.getvalue().splitlines()[3:-1]}
    assert "differs: raise RENDER_MODEL" in rows["open"]
    assert "not shipped yet" in rows["dense"]
    assert "agrees" in rows["clearing"]
    assert len(list((tmp_path / "new").iterdir())) == 4


def test_the_verb_takes_the_folder_and_ends_with_the_verdict(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(checked_panoramas, "run_check_panoramas", lambda out: seen.append(out))
    with pytest.raises(SystemExit) as stopped:
        cli.main(["check", "panoramas", str(tmp_path)])
    assert (seen, stopped.value.code) == ([tmp_path], 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", NATURAL_PANORAMAS)
def test_what_grows_today_is_what_was_shipped(name):
    # A raise of RENDER_MODEL that was forgotten. Two light paths per pixel show the means of
    # blocks to a few per cent; twice what noise makes of their RMS comes by chance once in 3e8.
    coarse = NATURAL_PANORAMAS[name].model_copy(update={"samples_per_pass": 1, "passes": 2})
    found = compare(SHIPPED / f"{name}.exr", *render_panorama(coarse, lambda: None))
    assert found.agrees, found
