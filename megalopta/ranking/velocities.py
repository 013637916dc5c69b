"""Velocities that methods read from the photons of a sequence, each kept as soon as it is known.

Photons are drawn on perfect pixels from the rendered light, every frame scaled alike; all methods
see the same draws. The light itself, at the same number of photons but without their noise, gives
the velocities that a method is compared with itself by.
"""

from collections.abc import Callable, Iterator
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np

from megalopta import files
from megalopta.arrays import Floats
from megalopta.dataset import Dataset, file_hash, read_radiance_frames
from megalopta.flow.detectors import BlockGrid, Detector
from megalopta.flow.metrics import cramer_rao_covariance, fisher_information
from megalopta.flow.stimuli import draw_counts
from megalopta.freshness import code_digest, digest
from megalopta.ranking.methods import identity
from megalopta.ranking.pooling import Pooling
from megalopta.ranking.settings import RankingSettings
from megalopta.sensor import PRESETS, photon_rate


class Drawn(NamedTuple):
    """A draw of the photons of a sequence, or the light itself."""

    pooling: Pooling
    flux: float
    """Photons per frame, before frames are pooled"""
    repeat: int | None
    """None for light without noise"""


class Velocities:
    """Velocities of one sequence, computed once and kept in a folder.

    Parameters
    ----------
    dataset
        One sequence.
    settings
    folder
        Where they are kept.
    advance
        Called after each method and draw.
    """

    def __init__(
        self,
        dataset: Dataset,
        settings: RankingSettings,
        folder: Path,
        advance: Callable[[int], object] = lambda _: None,
    ) -> None:
        self._dataset, self._settings, self._advance = dataset, settings, advance
        self._folder = folder
        self._pooled: dict[Pooling, Floats] = {}

    def of(self, method: Detector, drawn: Drawn) -> Floats:
        """Velocities (pairs, rows, columns, 2) of all blocks, px of the full image per frame.

        Of a method without velocities its responses (T, H, W).
        """
        what = digest(self._frames, identity(method), repr(drawn), repr(self._settings.seed))
        kept = self._folder / _model() / f"{what}.npy"
        found = _read(kept)
        if found is None:
            found = self._measured(method, drawn)
            with files.atomic_write(kept) as temporary:
                np.save(temporary, found, allow_pickle=False)
        self._advance(1)
        return found.astype(np.float64)

    @property
    def photons_per_lux_s(self) -> float:
        """Photons of a mean frame on perfect pixels for each lux and second."""
        return _per_lux_s(self._dataset, self._light)

    def bound(self, grid: BlockGrid, pooling: Pooling, flux: float) -> Floats:
        """Least mean endpoint error that the photons of a pair allow in each block inside.

        (pairs, rows, columns), px of the full image per frame: √(π/4 · trace) of the covariance of
        Cramér and Rao for two frames, exact where that has no direction.
        """
        means = self._light_at(pooling) * (flux * pooling.frames)
        least = [cramer_rao_covariance(fisher_information(each, grid)) for each in means[:-1]]
        trace = np.trace(np.array(least), axis1=-2, axis2=-1)[:, 1:-1, 1:-1]
        return np.asarray(np.sqrt(np.pi / 4 * trace) * pooling.pixels / pooling.frames)

    def _measured(self, method: Detector, drawn: Drawn) -> Floats:
        light, pooling = self._light_at(drawn.pooling), drawn.pooling
        means = light * (drawn.flux * pooling.frames)
        frames = (
            means
            if drawn.repeat is None
            else draw_counts(means, self._settings.seed, self._dataset.sequence, *map(str, drawn))
        )
        found = method.respond(frames, 1 / means.mean())
        to_full = pooling.pixels / pooling.frames if method.gives == "velocity" else 1.0
        return (found * to_full).astype(np.float32)

    def _light_at(self, pooling: Pooling) -> Floats:
        """Share of the photons of a mean frame on each pixel of pooled frames."""
        if pooling not in self._pooled:
            light = pooling.light(self._light)
            self._pooled = {pooling: light / light.sum(axis=(1, 2)).mean()}
        return self._pooled[pooling]

    @cached_property
    def _light(self) -> Floats:
        return _light(self._dataset)

    @cached_property
    def _frames(self) -> str:
        """Hash of the frames: others have other velocities."""
        count = self._dataset.configuration.trajectory.frames
        return digest(*(file_hash(self._dataset.exposed_radiance(index)) for index in range(count)))


def draws(settings: RankingSettings) -> Iterator[Drawn]:
    """Yield every draw, those of a pooling together."""
    for pixels in settings.pixels_pooled:
        for frames in settings.frames_pooled:
            for flux in settings.fluxes:
                for repeat in (None, *range(settings.repeats)):
                    yield Drawn(Pooling(pixels, frames), flux, repeat)


def photons_per_lux_s(dataset: Dataset) -> float:
    """Photons of a mean frame on perfect pixels for each lux and second; reads all frames."""
    return _per_lux_s(dataset, _light(dataset))


def _per_lux_s(dataset: Dataset, light: Floats) -> float:
    photons_hz = float(light.sum(axis=(1, 2)).mean())
    return photons_hz / dataset.configuration.light.resolved().illuminance_lux


def _light(dataset: Dataset) -> Floats:
    bands = dataset.configuration.render.bands_nm
    parts = [
        photon_rate(each, bands, PRESETS["ideal"]) for _, each in read_radiance_frames(dataset)
    ]
    return np.concatenate(parts).astype(np.float64)


def _read(path: Path) -> Floats | None:
    try:
        return np.asarray(np.load(path, allow_pickle=False))
    except (OSError, ValueError, EOFError, BadZipFile):
        return None


@cache
def _model() -> str:
    return code_digest("megalopta.flow", "megalopta.sensor.sampling", __name__)[:12]
