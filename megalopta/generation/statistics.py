"""Statistics of a finished sequence."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from megalopta.dataset.frames import read_radiance_frame, read_truth_frame
from megalopta.dataset.record import ExposureStatistics, SequenceStatistics
from megalopta.dataset.store import Dataset, exposure_name
from megalopta.render import out_of_view
from megalopta.stages.sense import open_exposure

_FRAMES_LOOKED_AT = 8


def sequence_statistics(dataset: Dataset) -> SequenceStatistics:
    """Measure flow, depth and texture in a few evenly spaced frames, and all readings."""
    last = dataset.configuration.trajectory.frames - 2  # among frames with a forward flow
    frames = np.unique(np.linspace(0, last, min(_FRAMES_LOOKED_AT, last + 1)).astype(int)).tolist()
    speeds, unmatched, depths, sky, textures = [], [], [], [], []
    for index in frames:
        truth = read_truth_frame(dataset, index)
        flow, wraps = truth.flow_forward, dataset.configuration.camera.wraps
        speed = np.hypot(flow[..., 0], flow[..., 1])
        speeds.append(speed[~np.isnan(speed)])
        unmatched.append(np.mean(truth.occluded_forward | out_of_view(flow, wraps)))
        is_sky = np.isinf(truth.depth)
        sky.append(np.mean(is_sky))
        depths.append(truth.depth[~is_sky])
        textures.append(_texture(read_radiance_frame(dataset, index).sum(axis=-1)))
    speed, depth = np.concatenate(speeds), np.concatenate(depths)
    return SequenceStatistics(
        mean_speed_px=_rounded(speed.mean()) if speed.size else None,
        median_speed_px=_rounded(np.median(speed)) if speed.size else None,
        percentile_99_speed_px=_rounded(np.percentile(speed, 99)) if speed.size else None,
        unmatched_fraction=_rounded(np.mean(unmatched)),
        sky_fraction=_rounded(np.mean(sky)),
        median_depth_m=_rounded(np.median(depth)) if depth.size else None,
        texture=_rounded(np.mean(textures)),
        exposures=tuple(exposure_statistics(dataset)),
    )


def exposure_statistics(dataset: Dataset) -> Iterator[ExposureStatistics]:
    """Measure the readings of every sensor at every level."""
    for sensor, level in dataset.configuration.exposures:
        opened = open_exposure(dataset, sensor, level)
        yield ExposureStatistics(
            name=exposure_name(sensor, level),
            sensor=sensor.name,
            level=level,
            unit=sensor.unit,
            exposure_s=sensor.exposure_s,
            photons_per_pixel=_rounded(opened["photons"].mean()),
            mean_reading=_rounded(opened["counts"].mean()),
            saturated_fraction=_rounded(opened["saturated"].mean()),
        )


def _texture(light: NDArray[np.float32]) -> float:
    """RMS of the differences between neighbors, relative to the mean."""
    across, down = (np.diff(light.astype(np.float64), axis=axis).ravel() for axis in (1, 0))
    square = np.mean(np.square(np.concatenate([across, down])))
    return float(np.sqrt(square) / max(float(light.mean()), 1e-300))


def _rounded(value: float | np.floating) -> float:
    """Round to six digits: more would be noise."""
    return float(f"{float(value):.6g}")
