"""Frames of light on a sensor, and everything drawn from them.

The light of a frame is constant during its exposure, unless the following frames are given. Then it
moves towards them in steps, which affect readings, events, bits and their moments (for an
integrating sensor, through the mean; for contrast, without steps).

**Light between rendered frames** moves along the true flow, for events and bursts of short frames.
A point at x in frame t and at x + F(x) in frame t + 1 is at x + a·F(x) in between, for a from 0 to
1. A pixel's light is looked up in both frames and mixed with weights 1 − a and a; if the point is
occluded in the next frame, or leaves it, in the earlier frame alone. Newly visible light is that of
frame t + 1. Light is interpolated bilinearly, which softens detail finer than two pixels. The
motion is straight and uniform between two frames.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor import quantities
from megalopta.sensor.change import changed
from megalopta.sensor.contrast.model import ContrastSensor
from megalopta.sensor.expectations import expectation, settled
from megalopta.sensor.exposure import draw_frames
from megalopta.sensor.formats.products import Kind
from megalopta.sensor.histograms import expose_histograms
from megalopta.sensor.image_sensors import ImageSensor, detected_hz
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.spad.array import MOST_STORED, detection_rate
from megalopta.sensor.spad.counts import check_load
from megalopta.sensor.spad.model import Sensor


class Following(Protocol):
    """Frames towards which the light of some frames moves."""

    def between(self, frames: NDArray[Any], frame: int, shares: Floats) -> NDArray[np.floating]:
        """Return the radiance (S, H, W, B) at fractions, (S,) or (S, H, 1), of the way onwards."""

    def scaled(self, factor: NDArray[np.floating]) -> "Following":
        """Return the same motion of light scaled by a factor, (B,)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NextFrames:
    """Next frame of each of some frames, and the flow to it."""

    radiance: NDArray[Any]
    """(T, H, W, B): radiance of each next frame."""
    flow: NDArray[Any]
    """(T, H, W, 2): forward flow, px, +x right and +y down; where undefined, the light stays."""
    hidden: Mask
    """(T, H, W): True for pixels occluded in the next frame."""

    def scaled(self, factor: NDArray[np.floating]) -> "NextFrames":
        """Return the same motion with light multiplied by a factor per band, (B,)."""
        return replace(self, radiance=self.radiance * factor)

    def between(self, frames: NDArray[Any], frame: int, shares: Floats) -> Floats:
        """Return the radiance (S, H, W, B) at fractions of the way from one frame to the next."""
        flow, gone = self.flow[frame], self.hidden[frame].astype(np.float64)
        motion = np.where(np.isfinite(flow).all(axis=-1, keepdims=True), flow, 0.0)
        light = np.empty((len(shares), *frames.shape[1:]))
        for band in range(frames.shape[-1]):
            pair = frames[frame, ..., band], self.radiance[frame, ..., band]
            for part, share in enumerate(shares):
                light[part, ..., band] = _at(*pair, motion, gone, share)
        return light


def _at(before: Floats, after: Floats, flow: Floats, gone: Floats, share: float | Floats) -> Floats:
    """Light at a fraction of the way from one frame to the next, or those of the rows (H, 1)."""
    grid = np.indices(before.shape, dtype=np.float64)
    along = flow[..., ::-1].transpose(2, 0, 1)  # rows, columns
    moved = along
    for _ in range(3):  # the flow of the point that is here now, not before
        moved = np.stack([_look_up(axis, grid - share * moved) for axis in along])
    start, end = grid - share * moved, grid + (1 - share) * moved
    size = np.array(before.shape)[:, None, None] - 1
    leaves = ((end < 0) | (end > size)).any(axis=0) | (_look_up(gone, start) > 0.5)
    enters = ((start < 0) | (start > size)).any(axis=0)
    weight = np.where(leaves & ~enters, 0.0, np.where(enters & ~leaves, 1.0, share))
    return (1 - weight) * _look_up(before, start) + weight * _look_up(after, end)


def _look_up(image: NDArray[Any], places: Floats) -> Floats:
    values = map_coordinates(np.asarray(image, np.float64), places, order=1, mode="nearest")
    return np.asarray(values)


State: TypeAlias = Any
"""Of `draw_frames`; None at first."""
_BITS_AT_ONCE = 16
"""Binary frames of a burst drawn together."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Shot:
    """Frames of light on a sensor.

    What is drawn of them comes with the state of the array afterwards, if it is running, and starts
    from the state after the previous shot.
    """

    radiance: NDArray[Any]
    """(T, H, W, B)"""
    bands_nm: ArrayLike
    """(B, 2)"""
    sensor: ImageSensor
    draw: Draw
    following: Following | None = None
    """Following frames, towards which the light moves; default: it is constant."""
    sub_frames: int = 1
    """Equal parts of an exposure or burst, in each of which the light is constant."""
    burst_frames: int = 1
    """Binary frames per burst, which fill the time to the next frame."""
    is_running: bool = False
    """True for an array that is not reset between frames"""
    later_s: Floats | None = None
    """(T, H, W): delays of pulses for histograms, as for `expose_histograms`."""

    def __post_init__(self) -> None:
        """Raise ValueError if light would move beyond the next frame."""
        readout_s = getattr(self.sensor, "readout_s", 0.0)
        light_s = self.sensor.exposure_s + readout_s
        if self.following and light_s > self.period_s * (1 + 1e-9):
            raise ValueError(
                f"exposure_s{' + readout_s' * bool(readout_s)}: {light_s:g} is longer than a "
                f"frame, {self.period_s:g} s, after which the light is not known; shorten it"
            )

    @property
    def period_s(self) -> float:
        """Time between frames, s."""
        return self.draw.frame_period_s or self.sensor.exposure_s

    @cached_property
    def _light(self) -> tuple[NDArray[Any], Floats]:
        """Mean radiance (T, H, W, B), and `detected_hz`, of parts where a kind takes them."""
        if self.following is None:
            return self.radiance, detected_hz(self.radiance, self.bands_nm, self.sensor)
        has_parts = isinstance(self.sensor, Sensor | ContrastSensor)
        means, light = [], []
        for frame in range(len(self.radiance)):
            parts = self._parts(frame, self.sensor.exposure_s / self.period_s)
            is_contrast = isinstance(self.sensor, ContrastSensor)
            means.append(((parts[1:] + parts[:-1]) / 2 if is_contrast else parts).mean(axis=0))
            seen = parts if has_parts else means[-1][np.newaxis]
            light.append(detected_hz(seen, self.bands_nm, self.sensor))
        return np.stack(means), np.array(light) if has_parts else np.concatenate(light)

    def _parts(self, frame: int, share: float) -> NDArray[np.floating]:
        """Radiance (S, H, W, B) in the first share of a frame; of contrast, at ends of parts."""
        if self.following is None:
            return np.repeat(self.radiance[frame : frame + 1], self.sub_frames, axis=0)
        shares = share * (np.arange(self.sub_frames) + 0.5) / self.sub_frames
        if isinstance(self.sensor, ContrastSensor):
            shares = np.linspace(0, share, self.sub_frames + 1)
        if readout_s := getattr(self.sensor, "readout_s", 0.0):  # later rows see later light
            rows = np.linspace(0, readout_s / self.period_s, self.radiance.shape[1])
            shares = shares[:, np.newaxis, np.newaxis] + rows[:, np.newaxis]
        return self.following.between(self.radiance, frame, shares)

    def readings(self, state: State, is_stated: bool = True) -> tuple[quantities.Exposure, State]:
        """Draw readings, with their mean and variance if they are stated."""
        (radiance, light), sensor = self._light, self.sensor
        exposure, after = self._expose(light, sensor, self.draw, "counts", state)
        if is_stated:
            if self.is_running and isinstance(sensor, Sensor):
                sensor = settled(sensor)
            times = self.draw.first_frame, self.draw.frame_period_s
            stated = expectation(radiance, self.bands_nm, sensor, *times, light, state)
            exposure = replace(exposure, expectation=stated)
        return exposure, after

    def check_events(self) -> None:
        """Raise ValueError for light with more events per frame than fit into memory."""
        if isinstance(self.sensor, ContrastSensor):
            return  # known as they are drawn
        exposure_s, effects = self.sensor.exposure_s, self._spad.avalanche_effects
        for rate_hz in self._light[1]:
            check_load(rate_hz, exposure_s, effects, None, MOST_STORED)

    def drawn(
        self, kind: Kind, state: State, is_stated: bool = True
    ) -> Iterator[tuple[Any, State]]:
        """Yield readings of a kind, in pieces, and the state of a running array after each.

        Binary frames of a burst fill the time between frames in equal shares, each from a live
        start or, for a running array, from the end of the one before. Raises ValueError if the
        events of a frame do not fit into memory.
        """
        if kind == "readings":
            yield self.readings(state, is_stated)
        elif kind == "bits":
            yield self._expose(self._light[1], self._spad, self.draw, "bits", state)
        elif kind == "burst":
            yield from self._burst(state)
        elif kind == "events":
            for frame, light in enumerate(self._light[1]):
                draw = self.draw._replace(first_frame=self.draw.first_frame + frame)
                events, state = self._expose(light[np.newaxis], self.sensor, draw, kind, state)
                yield events, state
        else:
            seen = detection_rate(self._light[0], self.bands_nm, self._spad)
            for frame, rate_hz in enumerate(seen):
                later_s = None if self.later_s is None else self.later_s[frame : frame + 1]
                named: Any = {"seed": self.draw.seed, "stream": self.draw.stream}
                named |= {"first_frame": self.draw.first_frame + frame, "later_s": later_s}
                yield expose_histograms(rate_hz[np.newaxis], self._spad, **named), None

    def _burst(self, state: State) -> Iterator[tuple[Any, State]]:
        """Packed binary frames (n, H, ceil(W/8)) that fill the time between frames, in pieces."""
        sensor = changed(self._spad, exposure_s=self.period_s / self.burst_frames)
        part_of = np.arange(self.burst_frames) * self.sub_frames // self.burst_frames
        for frame in range(len(self.radiance)):
            rate_hz = detection_rate(self._parts(frame, 1.0), self.bands_nm, sensor)
            first = (self.draw.first_frame + frame) * self.burst_frames
            for start in range(0, self.burst_frames, _BITS_AT_ONCE):
                draw = Draw(self.draw.seed, f"{self.draw.stream}/burst", first + start)
                piece_hz = rate_hz[part_of[start : start + _BITS_AT_ONCE]]
                bits, state = self._expose(piece_hz, sensor, draw, "bits", state)
                yield bits, state

    def _expose(self, *what: Any) -> tuple[Any, State]:
        return draw_frames(*what, is_running=self.is_running)

    @property
    def _spad(self) -> Sensor:
        if not isinstance(self.sensor, Sensor):
            raise ValueError(f"{self.sensor.name}: an integrating sensor has no single events")
        return self.sensor
