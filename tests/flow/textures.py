"""Stimuli whose motion is known exactly."""

import numpy as np


def drifting_texture(velocity, frames=2, shape=(120, 160), blur_px=1.5, seed=0, margin=20):
    """Gaussian-blurred white noise that drifts by `velocity` (x, y) px per frame, mean 0.

    It is periodic over the frame and its margins and shifted by the phases of its Fourier
    transform, so that fractions of a pixel are exact; what is cut out is not periodic.
    """
    whole = tuple(side + 2 * margin for side in shape)
    spectrum = np.fft.rfft2(np.random.default_rng(seed).normal(size=whole))
    fy, fx = np.fft.fftfreq(whole[0])[:, np.newaxis], np.fft.rfftfreq(whole[1])
    spectrum *= np.exp(-2 * (np.pi * blur_px) ** 2 * (fx**2 + fy**2))
    ramp = -2j * np.pi * (fx * velocity[0] + fy * velocity[1])
    images = [np.fft.irfft2(spectrum * np.exp(t * ramp), whole) for t in range(frames)]
    return np.stack(images)[:, margin:-margin, margin:-margin]
