"""The camera's yaw rate from all answers of a method, also of those that give no velocity."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from megalopta.benchmark.methods import Methods
from megalopta.benchmark.ranking_record import YawRateError
from megalopta.benchmark.ranking_settings import Pooling, RankingSettings
from megalopta.benchmark.velocities import Drawn, Velocities
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark.settings import default_warm_up
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.registry import Method, method
from megalopta.flow.egomotion.yaw_rate import YawRateTest, yaw_rates_deg_s

YawErrors = Mapping[tuple[float, str], tuple[float, float, float]]
"""True rate, error without noise and error on photons (deg/s, RMS), by photons and method"""


def directional_methods(ranked: Methods, more: Iterable[Method]) -> Mapping[str, Detector]:
    """Return the ranked methods, and others that tell the direction of motion.

    Raises
    ------
    ValueError
        When one is unknown, or blind to direction.
    """
    found: dict[str, Detector] = dict(ranked)
    for detector in map(method, more):
        if not detector.tells_direction:
            raise ValueError(
                f"wide_field: {detector.name!r} is blind to direction, so no yaw rate follows from "
                "it; leave it out"
            )
        found[detector.name] = detector
    return found


def yaw_errors(
    dataset: Dataset,
    settings: RankingSettings,
    methods: Mapping[str, Detector],
    velocities: Velocities,
) -> YawErrors:
    """Learn the rate from clean answers to the first half of a sequence, and try it on the rest."""
    rates = yaw_rates_deg_s(dataset.configuration.trajectory)
    found = {}
    for name, detector in methods.items():
        for flux in settings.fluxes:
            test = YawRateTest(detector, rates, default_warm_up(len(rates) + 1, [detector]))
            test.add(
                *(velocities.of(detector, Drawn(Pooling(1, 1), flux, each)) for each in (None, 0))
            )
            if result := test.result():
                found[flux, name] = result.true_deg_s, result.ideal_deg_s, result.counts_deg_s
    return found


def typical(parts: Sequence[YawErrors]) -> tuple[YawRateError, ...]:
    """Return medians over sequences, of those in which the camera turns."""
    keys = dict.fromkeys(key for part in parts for key in part)
    return tuple(
        YawRateError(
            photons_per_frame=flux,
            method=name,
            true_deg_s=true,
            ideal_deg_s=ideal,
            counts_deg_s=counts,
        )
        for flux, name in keys
        for true, ideal, counts in [
            np.median([part[flux, name] for part in parts if (flux, name) in part], axis=0).tolist()
        ]
    )
