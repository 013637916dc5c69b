"""Image interpolation on textures for which its answer is known."""

import numpy as np
import pytest

from megalopta.flow.detectors.image_interpolation import ImageInterpolation


def drifting(k_x, shift, size=60, k_y=2 * np.pi / 6, frames=2):
    """A sinusoid along x that drifts by `shift` px per frame over a still one along y.

    The still one gives the blocks a second gradient; both have whole periods in a block.
    """
    y, x = np.mgrid[:size, :size]
    return np.stack([np.sin(k_x * (x - t * shift)) + np.sin(k_y * y) for t in range(frames)])


@pytest.mark.parametrize("shift", [0.1, 0.5, 1.0, -0.7, 2.0])
@pytest.mark.parametrize("wavelength", [6, 3])
def test_velocity_on_a_sinusoid_is_sin_kd_over_sin_k(shift, wavelength):
    k = 2 * np.pi / wavelength
    frames = drifting(k, shift)
    for along, turned in ((0, frames), (1, frames.transpose(0, 2, 1))):
        velocities = ImageInterpolation().respond(turned)[0, 1:-1, 1:-1]
        expected = np.sin(k * shift) / np.sin(k)
        np.testing.assert_allclose(velocities[..., along], expected, atol=1e-12)
        np.testing.assert_allclose(velocities[..., 1 - along], 0, atol=1e-12)


@pytest.mark.parametrize("axes", [(), (1,), (2,)])
def test_texture_of_fewer_than_two_directions_has_no_velocity(axes):
    y, x = np.mgrid[:30, :30]
    image = {(): np.ones((30, 30)), (1,): np.sin(y), (2,): np.sin(x)}[axes]
    frames = np.stack([image, np.roll(image, 1, axis=1)])
    assert np.isnan(ImageInterpolation().respond(frames)).all()
