"""Flights through forests: how well methods estimate the camera's own motion, over the photons.

The camera turns to the left and to the right by up to 0.7° per frame, nods and rolls by up to half
a degree, and flies 10 cm per frame, up to 30° aside of where it looks and 8° upward, so that
neither rotation nor heading stays near an axis. Trees 2 m away pass at some 2 px per frame.

A weighted sum of local answers (`flow.egomotion.wide_field`) has to learn what a rotation looks
like: it learns from light without noise in the first half. Its rates are averaged over the frames
that the likelihood sees. The likelihood, and the motion that fits flow best, need no learning.
"""

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.benchmark.clips import Clip
from megalopta.benchmark.moving_forests import VIEW_SETTINGS, MovingView
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector, Frames
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.detectors.summed_frames import summed_frames
from megalopta.flow.egomotion.heading import CameraMotion, motion_of_flow
from megalopta.flow.egomotion.likely_motion import likely_camera_motion
from megalopta.flow.egomotion.wide_field import fit_wide_field
from megalopta.flow.egomotion.yaw_rate import yaw_rates_deg_s
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.scenes import Camera, Forest, Light, PerspectiveCamera, Recorded
from megalopta.sensor.sampling import generator

FRAMES = 80
POOLED = 8
"""Frames from which the motion in their middle is told"""

FLIGHTS = 3
FLIGHT_FLUXES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Beyond, noise of rendering is more than that of photons"""

FLIGHT_DRAWS = 2

_WEIGHTED = "BM", "EMD", "PM", "DIS"
_STEP_M, _EYE_M, _CLIMB_DEG = 0.1, 1.6, 8.0
_LARGEST_TURN_DEG, _LARGEST_ASIDE_DEG = 0.7, 30.0
_LARGEST_NOD_DEG, _NODS, _ROLLS = 3.0, 2.0, 2.5
_RATE_HZ = 20.0
_SAMPLES = 128
_WARM_UP = 16
_REPLICATES = 2000

Told = tuple[Floats, Floats]
"""Yaw rates (n,), degrees per frame, and headings (n, 3), NaN where there are none"""

Way = Callable[[Frames, float], Told]
"""From counts of the whole flight and their photons per pixel to the motion in some middles"""


def forest_flight(preset: str = "open", seed: int = 5) -> MovingView:
    """Return a flight; it turns both ways in each of its halves."""
    return MovingView(
        forest=Forest.model_validate({"preset": preset, "seed": seed, "trees": 60}),
        light=Light(level="daylight", disc_fraction=0.3),
        camera=PerspectiveCamera(width=120, height=120, fov_deg=60),
        trajectory=Recorded(frames=FRAMES, frame_rate_hz=_RATE_HZ, csv=_recording()),
        settings=VIEW_SETTINGS.model_copy(update={"samples_per_pixel": _SAMPLES}),
    )


def forest_flights(count: int = FLIGHTS) -> dict[str, MovingView]:
    """Return flights through so many forests, by name."""
    return {f"flight {number + 1}": forest_flight(seed=5 + number) for number in range(count)}


@dataclass(frozen=True)
class MotionErrors:
    """Errors of one way to estimate the camera's motion."""

    name: str
    yaw_deg: Floats
    """(windows, draws, fluxes), degrees per frame"""
    heading_deg: Floats
    """(windows, draws, fluxes); NaN of ways that tell no heading"""
    true_yaw_deg: Floats
    """(windows,), degrees per frame"""
    fluxes: tuple[float, ...]
    """Photons per pixel and frame"""

    @property
    def rms_yaw_deg(self) -> float:
        """Root mean square of the true rate, degrees per frame."""
        return float(np.sqrt(np.mean(self.true_yaw_deg**2)))

    @property
    def yaw(self) -> Floats:
        """Root mean square error of the yaw rate over that of the rate, (fluxes,)."""
        return np.asarray(np.sqrt((self.yaw_deg**2).mean(axis=(0, 1))) / self.rms_yaw_deg)

    @property
    def heading(self) -> Floats:
        """Median angle between the true heading and that found (degrees), (fluxes,)."""
        return np.asarray(np.median(self.heading_deg, axis=(0, 1)))

    def intervals(self) -> tuple[Floats, Floats]:
        """Return what holds `yaw` and `heading` in 95 % of bootstraps, (2, fluxes) each.

        Windows are drawn, with all their draws of photons: these see the same places.
        """
        rng, size = generator(0, "forest flight interval"), len(self.yaw_deg)
        chosen = rng.integers(size, size=(_REPLICATES, size))
        yaw = np.sqrt((self.yaw_deg**2)[chosen].mean(axis=(1, 2))) / self.rms_yaw_deg
        heading = np.median(self.heading_deg[chosen], axis=(1, 2))
        low, high = (np.percentile(each, (2.5, 97.5), axis=0) for each in (yaw, heading))
        return low, high


def together(flights: Sequence[Sequence[MotionErrors]]) -> list[MotionErrors]:
    """Return the errors of each way over all flights."""
    return [
        MotionErrors(
            parts[0].name,
            np.concatenate([each.yaw_deg for each in parts]),
            np.concatenate([each.heading_deg for each in parts]),
            np.concatenate([each.true_yaw_deg for each in parts]),
            parts[0].fluxes,
        )
        for parts in zip(*flights, strict=True)
    ]


def flight_errors(
    view: MovingView,
    clip: Clip,
    fluxes: Sequence[float] = FLIGHT_FLUXES,
    draws: int = FLIGHT_DRAWS,
    after_draw: Callable[[], object] = lambda: None,
) -> list[MotionErrors]:
    """Return the errors of all ways to estimate the camera's motion, on the same photons.

    Parameters
    ----------
    view, clip
        A flight and its frames.
    fluxes
        Photons per pixel and frame, on average.
    draws : int
        Of the photons.
    after_draw
        Called after each.
    """
    poses = view.trajectory.poses()
    rates = yaw_rates_deg_s(view.trajectory) / view.trajectory.frame_rate_hz
    half = (_WARM_UP + len(rates)) // 2
    # pairs in the second half, whose windows share no frame
    middles = np.arange(half, len(rates) - POOLED // 2 + 1, POOLED)
    steps = np.diff(poses[:, :3, 3], axis=0)[middles, np.newaxis] @ poses[middles, :3, :3]
    headings = steps[:, 0] / np.linalg.norm(steps[:, 0], axis=1, keepdims=True)
    ways = _ways(view.camera, clip.light[: half + 1], rates[:half], middles)
    yaw = {name: np.empty((len(middles), draws, len(fluxes))) for name in ways}
    aside = {name: np.empty_like(each) for name, each in yaw.items()}
    for draw, place in np.ndindex(draws, len(fluxes)):
        flux = fluxes[place]
        counts = draw_counts(clip.light * flux, 0, clip.name, f"{flux:.6g}", draw)
        for name, way in ways.items():
            turns, found = way(counts, flux)
            yaw[name][:, draw, place] = turns - rates[middles]
            cosines = np.clip((found * headings).sum(axis=1), -1, 1)
            aside[name][:, draw, place] = np.degrees(np.arccos(cosines))
        after_draw()
    return [
        MotionErrors(name, errors, aside[name], rates[middles], tuple(fluxes))
        for name, errors in yaw.items()
    ]


def _ways(
    camera: Camera, light: Floats, rates: Floats, middles: NDArray[np.intp]
) -> Mapping[str, Way]:
    """Return ways to tell the motion in the middles, by name; some learn from light and rates."""
    blocks = [each for each in (METHODS["DIS"], METHODS["PPF"]) if isinstance(each, BlockDetector)]
    flows = [summed_frames(blocks[0], POOLED), blocks[1]]
    return {
        **{f"{name}, summed": _summed(METHODS[name], light, rates, middles) for name in _WEIGHTED},
        **{f"{each.name}, fitted": partial(_fitted, each, camera, middles) for each in flows},
        **{
            f"likelihood of {frames} frames": partial(_likely, frames, camera, middles)
            for frames in (2, POOLED)
        },
    }


def _summed(detector: Detector, light: Floats, rates: Floats, middles: NDArray[np.intp]) -> Way:
    """Return the weighted sum of a method's answers, its rates averaged over seven pairs."""
    # of a pair of frames, or of the last of them
    skipped = 0 if detector.gives == "velocity" else 1
    answers = detector.respond(light)[skipped:]
    field = fit_wide_field(answers[_WARM_UP:], rates[_WARM_UP:])
    near = middles[:, np.newaxis] + np.arange(POOLED - 1) - (POOLED // 2 - 1)

    def tell(counts: Frames, flux: float) -> Told:
        found = field.rates(detector.respond(counts, 1 / flux)[skipped:])
        return np.nan_to_num(found[near]).mean(axis=1), np.full((len(middles), 3), np.nan)

    return tell


def _fitted(
    detector: BlockDetector,
    camera: Camera,
    middles: NDArray[np.intp],
    counts: Frames,
    flux: float,
) -> Told:
    """Tell the motion that fits the velocities of blocks best."""
    centers = detector.grid((camera.height, camera.width)).centers
    motions = []
    for middle in middles:
        # a block that answers nothing counts as at rest, as it does in a sum
        velocities = np.nan_to_num(detector.respond(_window(counts, middle, POOLED))[-1])
        motions.append(motion_of_flow(camera, centers, velocities))
    return _told(motions)


def _likely(
    frames: int, camera: Camera, middles: NDArray[np.intp], counts: Frames, flux: float
) -> Told:
    """Tell the most likely motion."""
    return _told(
        [likely_camera_motion(_window(counts, middle, frames), camera) for middle in middles]
    )


def _window(counts: Frames, middle: int, frames: int) -> Frames:
    """Return so many frames, half of them up to the first of the pair in the middle."""
    return counts[middle + 1 - frames // 2 : middle + 1 + frames // 2]


def _told(motions: Sequence[CameraMotion]) -> Told:
    turns = np.array([each.rotation_deg[1] for each in motions])
    return turns, np.array([each.heading for each in motions])


def _recording() -> str:
    """Return the path as CSV: time, position and quaternion."""
    times = np.arange(FRAMES)
    phase = 2 * np.pi * times / FRAMES
    look = np.radians(_LARGEST_TURN_DEG) * FRAMES / (2 * np.pi) * np.sin(phase)
    way = look - np.radians(_LARGEST_ASIDE_DEG) * np.sin(phase / 2)
    climb = np.radians(_CLIMB_DEG)
    steps = np.column_stack(
        (np.cos(climb) * np.cos(way), np.cos(climb) * np.sin(way), np.full(FRAMES, np.sin(climb)))
    )
    places = np.array([0, 0, _EYE_M]) + _STEP_M * (np.cumsum(steps, axis=0) - steps)
    nod, roll = _LARGEST_NOD_DEG * np.sin(_NODS * phase), _LARGEST_NOD_DEG * np.sin(_ROLLS * phase)
    body = Rotation.from_euler("ZYX", np.column_stack((np.degrees(look), nod, roll)), degrees=True)
    ahead = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # right, down and forward
    text = io.StringIO()
    table = np.column_stack((times / _RATE_HZ, places, (body * ahead).as_quat()))
    np.savetxt(text, table, delimiter=",", fmt="%.9f")
    return text.getvalue()
