"""The flow between two images in one call, by any method that gives velocities."""

from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from megalopta.core.arrays import Floats
from megalopta.core.bounded import quoted
from megalopta.flow.detectors.poisson_flow import PoissonFlow
from megalopta.flow.detectors.registry import Method, for_sensor, velocity_method
from megalopta.sensor import ImageSensor
from megalopta.sensor.image_sensors import sensor_named
from megalopta.sensor.quantities import Events, histogram


@overload
def optical_flow(
    first: ArrayLike,
    second: ArrayLike,
    method: Method = ...,
    *,
    sensor: ImageSensor | str | Path | None = ...,
    return_covariance: Literal[False] = ...,
    **settings: Any,
) -> Floats: ...
@overload
def optical_flow(
    first: ArrayLike,
    second: ArrayLike,
    method: Method = ...,
    *,
    sensor: ImageSensor | str | Path | None = ...,
    return_covariance: Literal[True],
    **settings: Any,
) -> tuple[Floats, Floats]: ...
def optical_flow(
    first: ArrayLike,
    second: ArrayLike,
    method: Method = "PF",
    *,
    sensor: ImageSensor | str | Path | None = None,
    return_covariance: bool = False,
    **settings: Any,
) -> Floats | tuple[Floats, Floats]:
    """Return the flow from one image to the next, (H, W, 2) in px: x to the right, then y down.

    With `return_covariance`, its covariances (H, W, 2, 2), px², too. The flow is NaN where
    undefined. That of a method of one velocity per block is interpolated linearly between block
    centers, and constant beyond the outermost. Raises ValueError if method, setting or images
    cannot be used.

    Parameters
    ----------
    first, second : (H, W)
        Photon counts for PM, PPM, PF, PPF and PF-fast, or readings of a frame camera in electrons;
        gray levels of any range for the others.
    method
        Name of a method in `METHODS`, a function of two images, `module:function`, the path of an
        ONNX file, or a detector.
    sensor
        That of the readings, if its noise is not that of counts: read noise, electron
        multiplication. `noise=(a, b)` says the same: their variance is a·mean + b.
    return_covariance
        True to get the covariance of the flow at each pixel, too; PF and PPF have one.
    **settings
        Settings of the method, such as `smoothness` of PF; its class lists them.

    Examples
    --------
    Counts of a texture that moves by a pixel to the right:

    >>> texture = np.random.default_rng(0).poisson(50, (64, 65))
    >>> flow = optical_flow(texture[:, 1:], texture[:, :-1])
    >>> np.median(flow, axis=(0, 1)).round(1)
    array([1., 0.])
    """
    if sensor is not None:
        method = for_sensor(method, sensor_named(sensor))
    detector = velocity_method(method)
    known = [name for name in type(detector).model_fields if name not in ("name", "label")]
    for name, value in settings.items():
        if name not in known:
            raise ValueError(
                f"{detector.name} has no setting {name} (value {quoted(value)}): choose from"
                f" {', '.join(known)}"
            )
    try:
        detector = type(detector).model_validate({**dict(detector), **settings})
    except ValidationError as error:
        problem = error.errors()[0]
        name, message = ".".join(map(str, problem["loc"])), problem["msg"]
        remedy = message.replace("Input should", "it should").removeprefix("Value error, ")
        raise ValueError(
            f"{detector.name}: {name} is {quoted(problem['input'])}; {remedy}"
        ) from None
    frames = [np.asarray(image) for image in (first, second)]
    for image in frames:
        if image.dtype.kind not in "buif":
            raise ValueError(f"an image of {image.dtype}: give numbers")
    frames = [image.astype(np.uint8) if image.dtype.kind == "b" else image for image in frames]
    are_gray_levels = all(
        image.size and image.min() >= 0 and image.max() <= 1 and (image != np.round(image)).any()
        for image in frames
    )
    if detector.takes_counts and are_gray_levels and detector.noise == (1.0, 0.0):
        raise ValueError(
            f"{detector.name} needs photon counts, but these are gray levels from 0 to 1: multiply"
            " them by the photons of the brightest, or choose another method, such as DIS"
        )
    if not return_covariance:
        return detector.dense(*frames)
    if not isinstance(detector, PoissonFlow):
        raise ValueError(f"return_covariance: {detector.name} has none; choose PF or PPF")
    return detector.dense_with_covariance(*frames)


def event_flow(events: Events, frames: int = 1, method: Method = "DIS", **settings: Any) -> Floats:
    """Return the flow between pictures of net contrast events, (n − 1, H, W, 2), px per picture.

    A picture holds `frames` consecutive frames; `method` and `settings` as for `optical_flow`. On
    scenes of `benchmarks/tune.py` at 10⁵ electrons per second, DIS is off by 0.93 px on average,
    maximal contrast of warped events, in blocks of 48 px, by 2.5, no motion by 3.3.
    """
    count = events.shape[0] // frames
    net = histogram(events)[: count * frames].reshape(count, frames, *events.shape[1:]).sum(axis=1)
    return np.array([optical_flow(*pair, method, **settings) for pair in pairwise(net)])
