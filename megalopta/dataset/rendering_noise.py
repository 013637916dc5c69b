"""Error of the rendering, from the headers of the frames that sensors see.

Figures are for pixels without sky if there are any, else for the whole image.

median_relative, rms_over_mean     over the measured frames, median and mean square
equivalent_photons_per_pixel       Poisson counts with the scatter of pixels of the median block
mean, covariance, detail           of bands, their error and the scene (`RenderNoise`),
                                   averaged over measured frames
surface, sky                       `RegionNoise` of either, over the measured frames: medians of
                                   median and p95, mean squares of other errors, means of shares;
                                   None without pixels of that kind
measured_frames                    numbers of the measured frames, from 0
samples_per_pixel, median_relative_of_frames, rms_over_mean_of_frames
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
    noises = dict[int, RenderNoise]()
    for index in frames:
        path = dataset.exposed_radiance(index)
        with undamaged(path, "remove it and render again"):
            if text := read_attributes(path).get(ATTRIBUTE):
                noises[index] = RenderNoise.from_json(text)
    if not noises:
        return None
    measured = list(noises)
    median = [noise.median_relative for noise in noises.values()]
    rms = [noise.rms_over_mean for noise in noises.values()]
    typical = float(np.median(median))
    return {
        "median_relative": typical,
        "rms_over_mean": float(np.sqrt(np.mean(np.square(rms)))),
        "equivalent_photons_per_pixel": 1 / max(typical, 1e-6) ** 2,
        "mean": np.mean([noise.mean for noise in noises.values()], axis=0).tolist(),
        "covariance": np.mean([noise.covariance for noise in noises.values()], axis=0).tolist(),
        "detail": np.mean([noise.detail for noise in noises.values()], axis=0).tolist(),
        "surface": _region([noise.surface for noise in noises.values()]),
        "sky": _region([noise.sky for noise in noises.values()]),
        "measured_frames": measured,
        "samples_per_pixel": [
            samples_per_pass * (noises[index].passes if index in noises else 1) for index in frames
        ],
        "median_relative_of_frames": np.interp(frames, measured, median).tolist(),
        "rms_over_mean_of_frames": np.interp(frames, measured, rms).tolist(),
    }


def _region(regions: Sequence[RegionNoise | None]) -> dict[str, Any] | None:
    """One region over the frames that contain it."""
    seen = [asdict(region) for region in regions if region]
    if not seen:
        return None
    combine: dict[str, Callable[[Any], Any]] = {
        **dict.fromkeys(("share", "gradient", "standing_gradient"), np.mean),
        **dict.fromkeys(("median", "p95"), np.median),
        **dict.fromkeys(("rms", "standing"), lambda values: np.sqrt(np.mean(np.square(values)))),
    }
    record = {name: float(how([region[name] for region in seen])) for name, how in combine.items()}
    bands = np.sqrt(np.mean(np.square([region["bands"] for region in seen]), axis=0)).tolist()
    return {**record, "bands": bands}
