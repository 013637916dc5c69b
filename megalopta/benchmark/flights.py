"""Errors of the estimated camera motion on flights through forests, by photons.

A weighted sum of local responses (`flow.egomotion.wide_field`) learns its weights from noise-free
light in the first half. Its rates are averaged over the frames that the likelihood sees. The
likelihood, and the motion that best fits flow, need no learning.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.benchmark.clips import FlowClip
from megalopta.benchmark.moving_forests import MovingView
from megalopta.benchmark.table import (
    Case,
    Interval,
    Samples,
    gathered,
    measure_samples,
    median_of,
    root_mean_square,
)
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector, Frames
from megalopta.flow.detectors.blocks import BlockDetector, summed_frames
from megalopta.flow.detectors.registry import METHODS, velocity_method
from megalopta.flow.egomotion.camera_motion import likely_camera_motion
from megalopta.flow.egomotion.motion_of_flow import CameraMotion, motion_of_flow
from megalopta.flow.egomotion.wide_field import fit_wide_field, yaw_rates_deg_s
from megalopta.flow.metrics.endpoint_error import angles_deg
from megalopta.scenes import Camera

POOLED = 8
"""Frames from which the motion in their middle is estimated"""

FLIGHT_FLUXES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Photons per pixel and frame; above, rendering noise exceeds photon noise"""

FLIGHT_DRAWS = 2
YAW, HEADING = "yaw_error_deg", "heading_error_deg"

_WEIGHTED = "BM", "EMD", "PM", "DIS"
_WARM_UP = 16
_KEY = "forest flight interval"

Motions: TypeAlias = tuple[Floats, Floats | None]
"""Yaw rates (n,), degrees per frame, and headings (n, 3), or None without heading"""

Way: TypeAlias = Callable[[Frames, float], Motions]
"""Maps counts of the flight and their photons per pixel to the motion at some middles"""


@dataclass(frozen=True)
class FlightErrors:
    """Errors of all estimators of the camera's motion, in windows of frames."""

    samples: Samples
    """(windows, draws): yaw (degrees per frame) and heading (degrees), by estimator and photons"""
    true_yaw_deg: Floats
    """(windows,), degrees per frame"""

    @property
    def ways(self) -> list[str]:
        """Names of the estimators."""
        return list(dict.fromkeys(case.method for case in self.samples))

    @property
    def fluxes(self) -> list[float]:
        """Photons per pixel and frame."""
        return list(dict.fromkeys(case.photons for case in self.samples))

    @property
    def rms_yaw_deg(self) -> float:
        """RMS of the true yaw rate, degrees per frame."""
        return float(np.sqrt(np.mean(self.true_yaw_deg**2)))

    def yaw(self, way: str, flux: float) -> Interval:
        """Return the RMS error of the yaw rate relative to its RMS."""
        return root_mean_square(self.samples[Case(YAW, way, flux)] / self.rms_yaw_deg)

    def heading(self, way: str, flux: float) -> Interval | None:
        """Return the median angle between the true and the estimated heading (degrees)."""
        samples = self.samples.get(Case(HEADING, way, flux))
        return None if samples is None else median_of(samples, _KEY)


def together(flights: Sequence[FlightErrors]) -> FlightErrors:
    """Return the errors of each estimator over all flights."""
    return FlightErrors(
        gathered(each.samples for each in flights),
        np.concatenate([each.true_yaw_deg for each in flights]),
    )


def flight_errors(
    view: MovingView,
    clip: FlowClip,
    fluxes: Sequence[float] = FLIGHT_FLUXES,
    draws: int = FLIGHT_DRAWS,
    after_draw: Callable[[], object] = lambda: None,
) -> FlightErrors:
    """Return the errors of all estimators of the camera's motion, on the same photons.

    Fluxes are mean photons per pixel and frame of the clip of a flight.
    """
    poses = view.trajectory.poses()
    rates = yaw_rates_deg_s(view.trajectory) / view.trajectory.frame_rate_hz
    half = (_WARM_UP + len(rates)) // 2
    # pairs in the second half, with disjoint windows
    middles = np.arange(half, len(rates) - POOLED // 2 + 1, POOLED)
    steps = np.diff(poses[:, :3, 3], axis=0)[middles, np.newaxis] @ poses[middles, :3, :3]
    ways = _ways(view.camera, clip.light[: half + 1], rates[:half], middles)

    def errors(counts: Frames, flux: float) -> Iterator[tuple[str, str, Floats]]:
        for name, way in ways.items():
            turns, found = way(counts, flux)
            yield YAW, name, turns - rates[middles]
            if found is not None:
                yield HEADING, name, angles_deg(found, steps[:, 0])

    samples = measure_samples(clip.counts, errors, fluxes, draws, after_draw)
    return FlightErrors(samples, rates[middles])


def _ways(
    camera: Camera, light: Floats, rates: Floats, middles: NDArray[np.intp]
) -> Mapping[str, Way]:
    """Return estimators of the motion at the middles; some learn from light and rates."""
    flows = [summed_frames(velocity_method("DIS"), POOLED), velocity_method("PPF")]
    return {
        **{f"{name}, summed": _summed(METHODS[name], light, rates, middles) for name in _WEIGHTED},
        **{
            f"{each.name}, fitted": _of_windows(POOLED, middles, partial(_fitted, each, camera))
            for each in flows
        },
        **{
            f"likelihood of {frames} frames": _of_windows(
                frames, middles, partial(likely_camera_motion, camera=camera)
            )
            for frames in (2, POOLED)
        },
    }


def _fitted(detector: BlockDetector, camera: Camera, counts: Frames) -> CameraMotion:
    """Return the motion that best fits the velocities of blocks."""
    centers = detector.grid((camera.height, camera.width)).centers
    # a block without velocity counts as at rest, as in a sum
    return motion_of_flow(camera, centers, np.nan_to_num(detector.respond(counts)[-1]))


def _summed(detector: Detector, light: Floats, rates: Floats, middles: NDArray[np.intp]) -> Way:
    """Return the weighted sum of a method's responses, its rates averaged over seven pairs."""
    # for a pair of frames, or its last
    skipped = 0 if detector.gives == "velocity" else 1
    answers = detector.respond(light)[skipped:]
    field = fit_wide_field(answers[_WARM_UP:], rates[_WARM_UP:])
    near = middles[:, np.newaxis] + np.arange(POOLED - 1) - (POOLED // 2 - 1)

    def estimate(counts: Frames, flux: float) -> Motions:
        found = field.rates(detector.respond(counts, 1 / flux)[skipped:])
        return np.nan_to_num(found[near]).mean(axis=1), None

    return estimate


def _of_windows(
    frames: int, middles: NDArray[np.intp], motion: Callable[[Frames], CameraMotion]
) -> Way:
    """Return the estimator that uses this many frames around each middle."""

    def estimate(counts: Frames, _: float) -> Motions:
        firsts = middles + 1 - frames // 2
        found = [motion(counts[first : first + frames]) for first in firsts]
        turns = np.array([each.rotation_deg[1] for each in found])
        return turns, np.array([each.heading for each in found])

    return estimate
