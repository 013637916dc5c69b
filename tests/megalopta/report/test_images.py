import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

from megalopta.report.images import (
    GRAY,
    ORANGE,
    data_uri,
    film_strip,
    gray_scale,
    map_scale,
    rgb_picture,
)


def decoded(uri):
    kind, _, data = uri.partition(",")
    assert kind == "data:image/png;base64"
    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        return np.asarray(image.convert("RGB"))


def test_counts_go_from_black_to_white_and_saturated_ones_are_orange():
    counts = np.array([[0.0, 5.0, 10.0, 99.0]])
    full = np.array([[False, False, False, True]])
    black, middle, white, saturated = decoded(data_uri(gray_scale(10.0).picture(counts, full)))[0]
    assert tuple(black) == (0, 0, 0)
    assert tuple(white) == (255, 255, 255)
    assert tuple(saturated) == ORANGE
    # Half the light is gray 255 · 0.5^(1/2.2) = 186; colors are 2.7 apart.
    assert middle[0] == pytest.approx(186, abs=3)
    assert len(set(middle)) == 1


def test_values_beyond_a_scale_have_the_colors_of_its_ends():
    scale = map_scale("RdBu_r", -1.0, 1.0, root=3.0)
    pixels = decoded(data_uri(scale.picture(np.array([[-9.0, -1.0, 1.0, 9.0, np.nan]]))))[0]
    np.testing.assert_array_equal(pixels[0], pixels[1])
    np.testing.assert_array_equal(pixels[2], pixels[3])
    assert tuple(pixels[4]) == GRAY


def test_a_legend_runs_through_all_colors_of_its_scale():
    scale = map_scale("viridis", 2.0, 50.0, logarithmic=True)
    legend = scale.legend("2", "50 m", "sky")
    bar = decoded(re.search('src="([^"]+)"', legend)[1])[0]
    np.testing.assert_array_equal(bar[[0, -1]], scale.colors[[0, -1]])
    assert "color scale from 2 to 50 m" in legend
    assert "rgb(128, 128, 128)" in legend and "sky" in legend


@pytest.mark.parametrize("kind", ["indexed", "rgb"])
def test_a_film_holds_its_frames_above_each_other(kind):
    rng = np.random.default_rng(0)
    if kind == "rgb":
        images = [rgb_picture(rng.integers(0, 256, (4, 6, 3), np.uint8)) for _ in range(3)]
    else:
        images = [gray_scale(1.0).picture(rng.random((4, 6))) for _ in range(3)]
    film = decoded(data_uri(film_strip(images)))
    for index, image in enumerate(images):
        np.testing.assert_array_equal(film[4 * index : 4 * index + 4], image.convert("RGB"))
