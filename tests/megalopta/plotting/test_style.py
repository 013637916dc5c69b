"""Curves that readers can tell apart."""

import pytest

from megalopta.flow.detectors.registry import METHODS
from megalopta.plotting.style import (
    house_style,
    method_style,
    new_canvas,
    wrapped,
)


def test_no_two_methods_look_alike():
    looks = [tuple(method_style(name).values()) for name in METHODS]
    assert len(set(looks)) == len(METHODS)


@pytest.mark.parametrize("characters", range(20, 60))
def test_no_number_is_parted_from_its_unit(characters):
    text = "It falls to 25 % within 3 frames of 240 × 240 px, C = 1, at 13.58 V and 0.1 Hz/µm²."
    ends = [line.split()[-1] for line in wrapped(text, characters)[:-1]]
    assert not [end for end in ends if end[-1].isdigit() or end in ("×", "=")]


def test_long_title_stays_on_the_page():
    with house_style():
        canvas = new_canvas("Photons needed over velocity " * 4, "", 2.0)
        canvas.draw_without_rendering()
    (title, *_) = canvas.texts
    box = title.get_window_extent()
    assert box.x1 < canvas.bbox.x1
    assert box.y0 > canvas.bbox.y1 - (canvas.get_figheight() - 2.0) * canvas.dpi


def test_printed_values_stand_between_drawing_and_caption():
    table = [("", "Ours", "Dissertation"), ("Mean", "1.4 Hz", "1.8 Hz")]
    with house_style():
        canvas = new_canvas("Title", "Caption.", 2.0, table)
        canvas.draw_without_rendering()
    boxes = {text.get_text(): text.get_window_extent() for text in canvas.texts}
    assert boxes["Caption."].y1 < boxes["Mean"].y0
    assert boxes["Mean"].y1 < canvas.bbox.y1 - 2.0 * canvas.dpi
    assert boxes["Mean"].x1 < boxes["1.4 Hz"].x0 < boxes["1.4 Hz"].x1 < boxes["1.8 Hz"].x0
