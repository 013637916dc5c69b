import numpy as np
import pytest

from megalopta.benchmark.panoramas import NATURAL_PANORAMAS
from megalopta.flow.stimuli.statistics import image_statistics
from megalopta.reproduction import chapter4_scenes as module


def test_grating_is_the_product_of_two_turned_sines_at_the_pixels_that_pooling_keeps(made):
    figure = made("fig-4.2")
    row, column, brightness = np.array(figure.rows)[:, :3].T
    # floor((i + 1/2)·251/60) + 1/2, in frames of 251 pixels.
    y, x = (((2 * index + 1) * 251 // 120 + 0.5) / 251 for index in (row, column))
    along, across = ((x + y) / 2**0.5, (y - x) / 2**0.5)
    expected = 1 + np.sin(8 * np.pi * along) * np.sin(8 * np.pi * across)
    np.testing.assert_allclose(brightness, expected, atol=1e-12)


@pytest.fixture
def templates(monkeypatch):
    forests = {
        name: np.random.default_rng(recipe.forest.seed).gamma(2, 0.5, (120, 400))
        for name, recipe in NATURAL_PANORAMAS.items()
    }
    monkeypatch.setattr(module, "natural_templates", lambda cache=None: forests)
    return forests


@pytest.mark.slow
def test_forests_are_drawn_with_their_statistics(drawn, templates):
    figure = drawn("fig-4.3")
    rows = {
        name: dict(zip(figure.columns[1:], values, strict=True)) for name, *values in figure.rows
    }
    assert set(rows) == {*templates, "dead leaves"}
    for name, template in templates.items():
        # Gamma noise of shape 2 has contrast 1/√2, known from 48 000 pixels to 0.6 % (σ); five σ
        assert rows[name]["contrast"] == pytest.approx(2**-0.5, rel=0.03)
        assert rows[name] == vars(image_statistics(template))
    # Dead leaves have the scale-free spectrum that noise has not.
    assert rows["dead leaves"]["spectrum_slope"] < -1.5 < rows["open"]["spectrum_slope"]
