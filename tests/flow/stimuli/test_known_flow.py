"""Stimuli of whole frames: what is at a pixel is where the flow says one frame later."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from megalopta.flow.stimuli.known_flow import Layer, MovingLayers

SHAPE = (48, 64)


def ripples(rows, columns, periods=6):
    """A smooth texture without a seam."""
    y, x = np.mgrid[:rows, :columns]
    wave = np.sin(2 * np.pi * periods * x / columns + 1) + np.cos(2 * np.pi * 4 * y / rows)
    return 1 + wave / 4


def along_the_flow(first, second, flow):
    """Return how far apart frames are where the flow leads, away from the border."""
    y, x = np.mgrid[: first.shape[0], : first.shape[1]]
    moved = map_coordinates(second, (y + flow[..., 1], x + flow[..., 0]), order=3, mode="nearest")
    return np.abs(moved - first)[8:-8, 8:-8]


def test_layers_move_as_their_flow_says():
    gradient = np.array([[0.02, -0.01], [0.005, -0.015]])
    scene = MovingLayers([Layer(ripples(160, 160), (1.7, -2.3), gradient)])
    first, second = scene.light(SHAPE, (2, 3))
    difference = along_the_flow(first, second, scene.flow(SHAPE, 2))
    # linear interpolation between texels of this curvature, and the box of a pixel that is turned
    assert difference.max() < 3e-3
    assert np.abs(second - first).max() > 0.2


def test_a_disk_hides_what_is_below_and_has_its_own_motion():
    still, white = np.zeros((2, 2)), np.full((8, 8), 5.0)
    layers = [Layer(ripples(160, 160), (0, 0), still), Layer(white, (3, 1), still, (0, 0, 10))]
    scene = MovingLayers(layers)
    light, flow = scene.light(SHAPE, (0, 2)), scene.flow(SHAPE, 2)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    inside = np.hypot(x + 0.5 - 32 - 6, y + 0.5 - 24 - 2) < 10
    np.testing.assert_array_equal(flow[inside], np.broadcast_to((3.0, 1.0), flow[inside].shape))
    assert not flow[~inside].any()
    soon_inside = np.hypot(x + 0.5 - 32 - 9, y + 0.5 - 24 - 3) < 10
    np.testing.assert_array_equal(scene.hidden(SHAPE, 2), soon_inside & ~inside)
    # area of a disk, to a pixel's share of its edge
    assert (light[1] == 5).sum() == pytest.approx(np.pi * 100, abs=2 * np.pi * 10)
