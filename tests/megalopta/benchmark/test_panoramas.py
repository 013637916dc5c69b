import numpy as np
import pytest
from PIL import Image

from megalopta.benchmark import panoramas
from megalopta.benchmark.panorama_recipes import NATURAL_PANORAMAS, NaturalPanorama, render_panorama
from megalopta.benchmark.panoramas import natural_templates, panorama_file, template_from_file
from megalopta.core.errors import UserError
from megalopta.render import RenderNoise
from megalopta.scenes import Forest, Light
from megalopta.scenes.spectra.color import encode_srgb
from megalopta.scenes.spectra.primaries import LUMINANCE_SHARES

NOISE = RenderNoise(2, 0.1, 0.1, (1.0,), ((0.01,),))


@pytest.fixture
def rendered(monkeypatch, tmp_path):
    """Names of forests by seed, in the order in which they are rendered; each a picture.

    No panorama is shipped.
    """
    order = []
    monkeypatch.setattr(panoramas, "SHIPPED", tmp_path / "nothing shipped")

    def fake(recipe, after_pass):
        after_pass()
        order.append(recipe.forest.seed)
        columns = recipe.camera.width
        light = np.random.default_rng(recipe.forest.seed).gamma(2, size=(251, columns, 1))
        return light.astype(np.float32), NOISE

    monkeypatch.setattr(panoramas, "render_panorama", fake)
    return order


def test_every_forest_is_rendered_once_and_then_read(rendered, tmp_path):
    first = natural_templates(tmp_path)
    again = natural_templates(tmp_path)
    assert rendered == [recipe.forest.seed for recipe in NATURAL_PANORAMAS.values()]
    for name in NATURAL_PANORAMAS:
        np.testing.assert_array_equal(first[name], again[name])


def test_a_killed_rendering_goes_on_with_the_forest_it_was_at(rendered, tmp_path, monkeypatch):
    working = panoramas.render_panorama

    def killed(recipe, after_pass):
        if len(rendered) == 2:
            raise KeyboardInterrupt
        return working(recipe, after_pass)

    monkeypatch.setattr(panoramas, "render_panorama", killed)
    with pytest.raises(KeyboardInterrupt):
        natural_templates(tmp_path)
    assert len(list((tmp_path / "panoramas").iterdir())) == 2
    monkeypatch.setattr(panoramas, "render_panorama", working)
    assert len(natural_templates(tmp_path)) == 4
    assert len(rendered) == len(set(rendered)) == 4


def test_templates_are_251_rows_of_mean_1_with_the_fields_of_view_of_the_dissertation(
    rendered, tmp_path
):
    for template, fov_deg in zip(
        natural_templates(tmp_path).values(), (100.4, 120.5, 160.6, 120.5), strict=True
    ):
        rows, columns = template.shape
        # Columns are whole: the field of view is met to half a column.
        assert abs(columns - 251 * 360 / fov_deg) <= 0.5
        assert rows == 251
        assert 2 <= columns / rows <= 4
        assert template.mean() == pytest.approx(1, abs=1e-12)


def test_another_configuration_is_another_file(tmp_path):
    recipe = NATURAL_PANORAMAS["open"]
    other = recipe.model_copy(update={"seed": 1})
    assert panorama_file("open", recipe, tmp_path) != panorama_file("open", other, tmp_path)


def test_the_cache_lies_where_the_environment_says(rendered, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    natural_templates()
    assert len(list((tmp_path / "megalopta/panoramas").glob("*.exr"))) == 4


def test_a_broken_file_in_the_cache_is_named(rendered, tmp_path):
    natural_templates(tmp_path)
    panorama_file("open", NATURAL_PANORAMAS["open"], tmp_path).write_bytes(b"half a fi")
    with pytest.raises(UserError, match=r"open-\w+\.exr is no panorama .*remove it"):
        natural_templates(tmp_path)


def test_pixels_are_square_at_the_horizon():
    for recipe in NATURAL_PANORAMAS.values():
        camera = recipe.camera
        lower, upper = camera.heights
        assert (upper - lower) / camera.height == pytest.approx(1 / camera.focal_length_px)


@pytest.mark.slow
def test_a_forest_is_rendered_pass_by_pass_with_sky_above_and_ground_below():
    forest = Forest(trees=50, density_per_ha=1500, undergrowth=0, detail=0.05, mix={"spruce": 1})
    recipe = NaturalPanorama(
        forest=forest,
        light=Light(level="starlight"),
        frame_fov_deg=180,
        samples_per_pass=1,
        passes=2,
    )
    passes = []
    radiance, noise = render_panorama(recipe, lambda: passes.append(1))
    assert len(passes) == noise.passes == 2
    assert radiance.shape == (251, 502, 1)
    # Litter reflects a tenth of what the sky sends, and trunks shade it: the forest's own closed
    # form is an inequality, and two paths per pixel are averaged over 126 000.
    sky, ground = radiance[:20].mean(), radiance[-60:].mean()
    assert 0 < ground < sky / 3


def colors(rows=251, columns=753, seed=0):
    return np.random.default_rng(seed).gamma(2, 0.1, size=(rows, columns, 3))


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "scale"), [(502, 1), (753, 2), (1004, 3)])
def test_a_file_is_binned_to_251_rows_by_area(picture, columns, scale):
    values = colors(columns=columns)
    template = template_from_file(picture(np.kron(values, np.ones((scale, scale, 1)))))
    expected = values @ LUMINANCE_SHARES
    assert template.dtype == np.float64
    # float32 in the file
    np.testing.assert_allclose(template, expected / expected.mean(), rtol=1e-5)


def test_png_is_decoded_to_linear_light(picture):
    values = colors().clip(0.05, 1)
    template = template_from_file(picture(values, "forest.png"))
    expected = values @ LUMINANCE_SHARES
    # Half a step of 8 bits is at most 1.5 % of light at 0.05 and above.
    np.testing.assert_allclose(template, expected / expected.mean(), rtol=0.02)


def test_gray_and_alpha_are_read(tmp_path):
    values = encode_srgb(colors().clip(0.05, 1))[..., 0]
    Image.fromarray(values).save(tmp_path / "gray.png")
    opaque = np.full_like(values, 255)
    Image.fromarray(np.stack([values] * 3 + [opaque], -1)).save(tmp_path / "alpha.png")
    gray, alpha = (template_from_file(tmp_path / f"{name}.png") for name in ("gray", "alpha"))
    np.testing.assert_allclose(gray, alpha, rtol=1e-5)


def with_one(value):
    values = colors()
    values[100, 300, 1] = value
    return values


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (with_one(np.nan), "not finite"),
        (with_one(np.inf), "not finite"),
        (with_one(-1e9), "values below 0"),
        (np.zeros((251, 753, 3)), "is black"),
        (colors(columns=400), "has 400 × 251 pixels"),
        (colors(columns=1006), "has 1006 × 251 pixels"),
        (colors(rows=100, columns=300), "has 100 rows; give a panorama of 251"),
    ],
    ids=["nan", "infinite", "negative", "black", "narrow", "wide", "small"],
)
def test_what_is_no_panorama_is_refused_in_one_sentence(picture, values, sentence):
    with pytest.raises(UserError, match=sentence) as refusal:
        template_from_file(picture(values))
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", ["missing.exr", "text.png", "folder"])
def test_what_cannot_be_read_is_refused_in_one_sentence(tmp_path, name):
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "folder").mkdir()
    with pytest.raises(UserError, match=f"{name} cannot be read") as refusal:
        template_from_file(tmp_path / name)
    assert "\n" not in str(refusal.value)
