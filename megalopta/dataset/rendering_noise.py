"""Error of the rendering, from the headers of the frames that sensors see.

Figures are for pixels without sky if there are any, else for the whole image.

rms_over_mean                      mean square over the measured frames
equivalent_photons_per_pixel       Poisson counts with the same scatter
mean, covariance, detail           of bands, their error and the scene (`RenderNoise`),
                                   averaged over measured frames
surface, sky                       `RegionNoise` of either, over the measured frames: mean
                                   squares of errors, means of shares; None without such pixels
measured_frames                    numbers of the measured frames, from 0
samples_per_pixel, rms_over_mean_of_frames
                                   of every frame; between measured frames, interpolated
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from megalopta.core.bounded import undamaged
from megalopta.dataset.store import Dataset
from megalopta.render import RegionNoise, RenderNoise, read_attributes

ATTRIBUTE = "monteCarlo"
"""Name of the header attribute with a measured frame's noise."""


def noise_record(dataset: Dataset, samples_per_pass: int) -> dict[str, Any] | None:
    """Collect the noise of all frames for the scene record; None if none was measured."""
    frames = range(dataset.configuration.trajectory.frames)
    found = {index: noise for index in frames if (noise := _noise(dataset, index))}
    if not found:
        return None
    measured = list(found)
    rms = [each.rms_over_mean for each in found.values()]
    total = float(np.sqrt(np.mean(np.square(rms))))
    return {
        "rms_over_mean": total,
        "equivalent_photons_per_pixel": 1 / max(total, 1e-6) ** 2,
        "mean": np.mean([each.mean for each in found.values()], axis=0).tolist(),
        "covariance": np.mean([each.covariance for each in found.values()], axis=0).tolist(),
        "detail": np.mean([each.detail for each in found.values()], axis=0).tolist(),
        "surface": _region([each.surface for each in found.values()]),
        "sky": _region([each.sky for each in found.values()]),
        "measured_frames": measured,
        "samples_per_pixel": [
            samples_per_pass * (found[index].passes if index in found else 1) for index in frames
        ],
        "rms_over_mean_of_frames": np.interp(frames, measured, rms).tolist(),
    }


def _region(regions: Sequence[RegionNoise | None]) -> dict[str, Any] | None:
    """One region over the frames that contain it."""
    seen = [asdict(each) for each in regions if each]
    if not seen:
        return None
    combine: dict[str, Callable[[Any], Any]] = {
        **dict.fromkeys(("share", "gradient", "standing_gradient"), np.mean),
        **dict.fromkeys(("rms", "standing"), lambda values: np.sqrt(np.mean(np.square(values)))),
    }
    record = {name: float(how([each[name] for each in seen])) for name, how in combine.items()}
    bands = np.sqrt(np.mean(np.square([each["bands"] for each in seen]), axis=0)).tolist()
    return {**record, "bands": bands}


def _noise(dataset: Dataset, index: int) -> RenderNoise | None:
    path = dataset.exposed_radiance(index)
    with undamaged(path, "remove it and render again"):
        text = read_attributes(path).get(ATTRIBUTE)
        return RenderNoise.from_json(text) if text else None
