"""Passes of a frame: one, or as many as bring its error to a target."""

from collections.abc import Callable

from megalopta.render.noise import Image, MeasuredPass, RenderNoise
from megalopta.render.scatter import RunningMean

RenderPass = Callable[[int], Image]
"""Renders the pass of a given number: radiance (H, W, B), independent of the other passes."""
MeasurePass = Callable[[int], MeasuredPass]
"""The same pass, with what its error is known by."""

MEASURED_EVERY = 16
"""Frames from one that is rendered twice to the next."""


def render_once(
    render_pass: RenderPass, measure_pass: MeasurePass | None
) -> tuple[Image, RenderNoise | None]:
    """Pass 0, (H, W, B), and its error by comparison with pass 1 where that is to be measured."""
    image = render_pass(0)
    if measure_pass is None:
        return image, None
    other = measure_pass(1)
    passes = RunningMean()
    passes.add(image)
    passes.add(other.radiance)
    return image, passes.noise(1, other)


def render_until(
    render_pass: RenderPass, measure_pass: MeasurePass, target_error: float, most_passes: int
) -> tuple[Image, RenderNoise]:
    """Mean (H, W, B) of as many passes as bring the RMS error on surfaces to the target.

    At least two, at most `most_passes`; the result says how many, and which error they left.
    """
    first = measure_pass(0)
    passes = RunningMean()
    passes.add(first.radiance)
    while True:
        passes.add(render_pass(passes.count))
        noise = passes.noise(passes.count, first)
        if noise.rms_over_mean <= target_error or passes.count >= most_passes:
            return passes.mean, noise
