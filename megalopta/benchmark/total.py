"""What was measured on all sequences, as a record."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations, product

import numpy as np

from megalopta.benchmark.camera_motion import CameraErrors
from megalopta.benchmark.intervals import best, interval, ratio
from megalopta.benchmark.measured import Part
from megalopta.benchmark.ranking_errors import STILL, Sums, units
from megalopta.benchmark.ranking_record import (
    BestMethod,
    CameraMotionError,
    Consistency,
    MeanError,
    Order,
    Ranking,
)
from megalopta.benchmark.ranking_settings import Pooling, RankingSettings
from megalopta.benchmark.sequence_truth import opposed
from megalopta.benchmark.yaw_rate import typical
from megalopta.core.arrays import Floats
from megalopta.dataset.store import Dataset

AllSums = Mapping[tuple[Pooling, float, str, str], Sums]
"""By pooling, photons per frame, group and method"""


def summed_up(
    datasets: Sequence[Dataset], settings: RankingSettings, parts: Sequence[Part]
) -> Ranking:
    """Return mean errors, the best methods and the order of any two, with what bears them."""
    sums = {key: units([part.sums[key] for part in parts]) for key in parts[0].sums}
    finest, first = settings.finest, settings.fluxes[0]
    blocks = {
        group: int(each.blocks.sum())
        for (pooling, flux, group, name), each in sums.items()
        if (pooling, flux, name) == (finest, first, STILL)
    }
    return Ranking(
        settings=settings,
        sequences=tuple(each.sequence for each in datasets),
        frames=sum(each.configuration.trajectory.frames for each in datasets),
        photons_per_lux_s=float(np.mean([part.photons_per_lux_s for part in parts])),
        blocks=blocks,
        errors=tuple(_errors(sums)),
        best=tuple(_best(sums, settings.methods)),
        orders=tuple(_orders(sums, settings, blocks)),
        consistency=tuple(
            Consistency(
                **pooling.record(flux),
                method=method,
                error=_number([part.consistency[pooling, flux, method] for part in parts]),
            )
            for pooling, flux, method in parts[0].consistency
        ),
        camera=tuple(
            _camera_motion(flux, name, [each for part in parts for each in part.camera[flux, name]])
            for flux, name in parts[0].camera
        ),
        yaw_rates=typical([part.yaw for part in parts]),
    )


def _errors(sums: AllSums) -> Iterator[MeanError]:
    for (pooling, flux, group, method), each in sums.items():
        if (found := interval(each)) is not None:
            yield MeanError(**pooling.record(flux), group=group, method=method, **found._asdict())


def _best(sums: AllSums, methods: Sequence[str]) -> Iterator[BestMethod]:
    for pooling, flux, group in dict.fromkeys(key[:3] for key in sums):
        own = {name: sums[pooling, flux, group, name] for name in (*methods, STILL)}
        if (found := best(own)) is not None:
            yield BestMethod(**pooling.record(flux), group=group, **found._asdict())


def _orders(sums: AllSums, settings: RankingSettings, blocks: Mapping[str, int]) -> Iterator[Order]:
    groups = dict.fromkeys(name for each in opposed(blocks) for name in each[:2])
    for flux, group in product(settings.fluxes, groups):
        for one, other in permutations(settings.methods, 2):
            found = ratio(*(sums[settings.finest, flux, group, name] for name in (other, one)))
            if found is not None and (found.ratio > 1 or (found.ratio == 1 and one < other)):
                yield Order(
                    photons_per_frame=flux, group=group, better=one, worse=other, **found._asdict()
                )


def _camera_motion(flux: float, method: str, found: Sequence[CameraErrors]) -> CameraMotionError:
    rotation, heading = np.array(found, np.float64).reshape(-1, 2).T
    return CameraMotionError(
        photons_per_frame=flux,
        method=method,
        rotation_deg=_number(rotation),
        heading_deg=_number(heading),
    )


def _number(values: Sequence[float] | Floats) -> float | None:
    """Median of what is defined, None where nothing is."""
    known = np.array(values)[~np.isnan(values)]
    return float(np.median(known)) if known.size else None
