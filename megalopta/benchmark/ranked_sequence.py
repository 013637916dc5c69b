"""A rendered sequence and the velocities of methods on its photons, each kept once computed.

Photons are drawn on perfect pixels from the rendered light, with one scale for all frames; all
methods see the same draws. The weights of a yaw rate are learned from the light itself, at the same
number of photons but without noise.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.benchmark.block_truths import SequenceTruth
from megalopta.benchmark.methods import Methods, identity
from megalopta.benchmark.ranking_settings import Pooling, RankingSettings
from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats
from megalopta.core.freshness import code_digest, digest
from megalopta.dataset.frames import read_radiance_frames
from megalopta.dataset.store import Dataset, file_hash
from megalopta.flow.camera_motion import likely_camera_motion, tell_motion
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.metrics.translation_bound import cramer_rao_covariance, fisher_information
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.scenes.cameras.base import Camera
from megalopta.sensor import PRESETS, photon_rate

_MOST_BYTES = 2**62
"""Size limit of the kept velocities: none"""


LIKELIHOODS: Mapping[str, int] = MappingProxyType(
    {"likelihood, 2 frames": 2, "likelihood, 8 frames": 8}
)
"""Names of the maximum-likelihood motions, and their numbers of frames"""


class Drawn(NamedTuple):
    """A photon draw of a sequence, or the light itself."""

    pooling: Pooling
    flux: float
    """Photons per frame, before pooling of frames"""
    repeat: int | None
    """None: light without noise"""


class RankedSequence:
    """A sequence, its ground truth, and velocities of methods, which are kept in a folder.

    `advance` is called after each new method and draw.
    """

    def __init__(
        self,
        dataset: Dataset,
        settings: RankingSettings,
        methods: Methods,
        folder: Path,
        advance: Callable[[int], object],
    ) -> None:
        self.dataset, self.settings, self.methods = dataset, settings, methods
        self._folder, self._advance = folder, advance
        self._pooled: dict[Pooling, Floats] = {}
        self._asked: set[str] = set()
        traced = cache(partial(SequenceTruth, dataset))
        self.truth = cache(lambda grid, pooling: traced(grid).at(pooling))
        """The `BlockTruths` of the blocks of a grid between pooled frames"""

    def grid(self, name: str, pixels: int) -> BlockGrid:
        """Return the blocks of a method on pooled frames; ValueError if these are too small."""
        shape = Pooling(pixels, 1).shape(self.dataset.configuration.camera.shape)
        return self.methods[name].grid(shape)

    def noisy(self, name: str, pooling: Pooling, flux: float) -> list[Floats]:
        """Return the velocities by a method in each photon draw."""
        draws = (Drawn(pooling, flux, repeat) for repeat in range(self.settings.repeats))
        return [self.velocities(self.methods[name], drawn) for drawn in draws]

    def velocities(self, method: Detector, drawn: Drawn) -> Floats:
        """Velocities (pairs, rows, columns, 2) of all blocks, px of the full image per frame.

        For a method without velocities, its responses (T, H, W).
        """
        return self._kept(drawn, identity(method), lambda: self._measured(method, drawn))

    def likely_motions(self, drawn: Drawn, name: str, pairs: Sequence[int]) -> Floats:
        """Most likely rotations (°) and headings of the camera around each pair, (pairs, 6)."""
        camera = self.dataset.configuration.camera

        def measured() -> Floats:
            counts = self._frames_of(drawn, self._means(drawn))
            found = [_likely_motion(camera, counts, LIKELIHOODS[name], pair) for pair in pairs]
            return np.array(found)

        return self._kept(drawn, f"{name}: {camera!r} {list(pairs)}", measured)

    @property
    def photons_per_lux_s(self) -> float:
        """Photons of a mean frame on perfect pixels, for each lux and second."""
        return photons_per_lux_s(self.dataset, self._light)

    def bound(self, grid: BlockGrid, pooling: Pooling, flux: float) -> Floats:
        """Least mean endpoint error that the photons of a pair allow in each inner block.

        (pairs, rows, columns), px of the full image per frame: √(π/4 · trace) of the Cramér–Rao
        covariance for two frames, exact if that is isotropic.
        """
        means = self._light_at(pooling) * (flux * pooling.frames)
        least = [cramer_rao_covariance(fisher_information(each, grid)) for each in means[:-1]]
        trace = np.trace(np.array(least), axis1=-2, axis2=-1)[:, 1:-1, 1:-1]
        return np.asarray(np.sqrt(np.pi / 4 * trace) * pooling.pixels / pooling.frames)

    def _kept(self, drawn: Drawn, name: str, measure: Callable[[], Floats]) -> Floats:
        """Return a measurement of a draw, kept or new."""
        what = digest(self._frames, name, repr(drawn), repr(self.settings.seed))
        store = ArrayStore(self._folder / _model(), what, _MOST_BYTES)
        kept = store.read(["found"])
        if kept is None:
            store.write(kept := {"found": measure().astype(np.float32)})
        if what not in self._asked:
            self._asked.add(what)
            self._advance(1)
        return kept["found"].astype(np.float64)

    def _measured(self, method: Detector, drawn: Drawn) -> Floats:
        pooling, means = drawn.pooling, self._means(drawn)
        found = method.respond(self._frames_of(drawn, means), 1 / means.mean())
        return found * (pooling.pixels / pooling.frames if method.gives == "velocity" else 1.0)

    def _frames_of(self, drawn: Drawn, means: Floats) -> NDArray[Any]:
        """Counts (T, H, W) of a draw, or their means."""
        if drawn.repeat is None:
            return means
        return draw_counts(means, self.settings.seed, self.dataset.sequence, *map(str, drawn))

    def _means(self, drawn: Drawn) -> Floats:
        return self._light_at(drawn.pooling) * (drawn.flux * drawn.pooling.frames)

    def _light_at(self, pooling: Pooling) -> Floats:
        """Share of the photons of a mean frame on each pixel of pooled frames."""
        if pooling not in self._pooled:
            light = pooling.light(self._light)
            self._pooled = {pooling: light / light.sum(axis=(1, 2)).mean()}
        return self._pooled[pooling]

    @cached_property
    def _light(self) -> Floats:
        return _light(self.dataset)

    @cached_property
    def _frames(self) -> str:
        """Hash of the frames: others have other velocities."""
        count = self.dataset.configuration.trajectory.frames
        return digest(*(file_hash(self.dataset.exposed_radiance(index)) for index in range(count)))


def photons_per_lux_s(dataset: Dataset, light: Floats | None = None) -> float:
    """Photons of a mean frame on perfect pixels, for each lux and second; reads all frames."""
    light = _light(dataset) if light is None else light
    photons_hz = float(light.sum(axis=(1, 2)).mean())
    return photons_hz / dataset.configuration.light.resolved().illuminance_lux


def _light(dataset: Dataset) -> Floats:
    bands = dataset.configuration.render.bands_nm
    frames = (each for _, each in read_radiance_frames(dataset))
    parts = [photon_rate(each, bands, PRESETS["ideal"]) for each in frames]
    return np.concatenate(parts).astype(np.float64)


def _likely_motion(
    camera: Camera, counts: NDArray[Any], frames: int, pair: int
) -> tuple[float, ...]:
    """Return the most likely rotation and heading, (6,), from frames around a pair, or NaN."""
    start = pair - (frames // 2 - 1)
    window = counts[max(start, 0) : start + frames]
    if len(window) < frames or not tell_motion(window):
        return (np.nan,) * 6
    found = likely_camera_motion(window, camera)
    return *found.rotation_deg, *found.heading


@cache
def _model() -> str:
    used = "megalopta.flow", "megalopta.sensor.sampling", "megalopta.scenes.cameras"
    return code_digest(*used, __name__)[:12]
