import numpy as np

from megalopta.flow.color_wheel import flow_to_rgb


def color(x, y, max_speed=1.0):
    return tuple(flow_to_rgb(np.array([x, y], float), max_speed).tolist())


def test_direction_is_hue():
    assert color(1, 0) == (255, 0, 0)
    down, left, up = color(0, 1), color(-1, 0), color(0, -1)
    assert down[0] > 200 and down[1] > 200 and down[2] == 0
    assert left[0] == 0 and left[1] > 100 and left[2] > 200
    assert up[0] > 50 and up[1] == 0 and up[2] > 200


def test_speed_is_saturation_and_darker_beyond_the_maximum_and_none_is_gray():
    assert color(0, 0) == (255, 255, 255)
    assert color(1, 0, max_speed=2) == (255, 128, 128)
    assert color(5, 0) == (191, 0, 0)
    assert color(np.nan, 1) == (128, 128, 128)
