"""Figures inside a page keep text that can be read."""

import pytest
from matplotlib.figure import Figure

from megalopta.plotting.svg import in_style, to_svg


@in_style
def drawn(width_in):
    return to_svg(Figure(figsize=(width_in, 2)), "figure", "A figure")


@pytest.mark.parametrize(("width_in", "least"), [(5.3, None), (10.0, "min-width: 540px")])
def test_a_wide_figure_scrolls_by_keyboard_too(width_in, least):
    svg = drawn(width_in)
    assert (least in svg) if least else ("min-width" not in svg)
    assert svg.startswith('<div class="scroll" role="region"' if least else '<svg class="plot"')
    assert svg.count('tabindex="0"') == bool(least)
