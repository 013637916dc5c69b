"""Panoramas: rendered once and shipped, or read from files of others."""

import hashlib
import runpy
from pathlib import Path

import numpy as np
import pytest

from megalopta.benchmark.panoramas import (
    NATURAL_PANORAMAS,
    SHIPPED,
    natural_template,
    template_from_file,
)
from megalopta.core.errors import UserError
from megalopta.scenes.spectra.color import LUMINANCE_SHARES

SHIPPED_SHA256 = {
    "clearing": "ef24378a2105156f36f2e26c1925236c1ad50162dbdfd7588ed1fd3fb8bfd850",
    "dense": "fc5e4f783749e7a97fb2fc9f4e0ee6d389a8df01a462df88f0633aa2992f1257",
    "open": "8810fd4cc409b97a0565a91214cfdfb68d26eba27243e223f76a57911e2a907c",
    "understorey": "9c1971a864bd89bfdc47677aae6abda72c0f1a7829d6b07902f16d8300543801",
}
SHIPPING = runpy.run_path(str(Path(__file__).parents[3] / "benchmarks/ship_panoramas.py"))


def test_templates_are_251_rows_of_mean_1_with_the_fields_of_view_of_the_dissertation():
    for name, fov_deg in NATURAL_PANORAMAS.items():
        template = natural_template(name)
        assert SHIPPING["RECIPES"][name].frame_fov_deg == fov_deg
        rows, columns = template.shape
        # Columns are whole: the field of view is met to half a column.
        assert abs(columns - 251 * 360 / fov_deg) <= 0.5
        assert rows == 251
        assert template.mean() == pytest.approx(1, abs=1e-12)


def colors(rows=251, columns=753, seed=0):
    return np.random.default_rng(seed).gamma(2, 0.1, size=(rows, columns, 3))


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "scale"), [(502, 1), (1004, 3)])
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


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (np.zeros((251, 753, 3)), "is black"),
        (colors(columns=1006), "has 1006 × 251 pixels"),
        (colors(rows=100, columns=300), "has 100 rows; give a panorama of 251"),
    ],
    ids=["black", "wide", "small"],
)
def test_what_is_no_panorama_is_refused_in_one_sentence(picture, values, sentence):
    with pytest.raises(UserError, match=sentence) as refusal:
        template_from_file(picture(values))
    assert "\n" not in str(refusal.value)


def test_stimuli_stay_as_they_were_whatever_a_forest_looks_like_later():
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) < 2e6
    assert set(SHIPPING["RECIPES"]) == set(SHIPPED_SHA256)
    for name, sha256 in SHIPPED_SHA256.items():
        assert hashlib.sha256((SHIPPED / f"{name}.exr").read_bytes()).hexdigest() == sha256
