"""`megalopta spadcam compare`: recordings against the device model's simulation of the stimulus.

The frames of a scene's dataset are a cycle, in which a recording begins anywhere. Of shifts by a
quarter of a frame, the one with the highest correlation is chosen.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.camera import comparison_page as pages, motion_bench
from megalopta.camera.emulator import Cycle, rendered
from megalopta.camera.sources import Beam, RecordingFrames, Source, read_recorded
from megalopta.core.errors import UserError, refused_as
from megalopta.core.progress import step
from megalopta.report.sections import write_sections
from megalopta.sensor import (
    IMAGE_SENSORS,
    AnalogCounter,
    Sensor,
    changed,
    compare_recordings,
    load_sensor,
)
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.model import Model, level_of_codes, one_by_one
from megalopta.sensor.compare.recordings import MARGIN, Comparison, compare_levels, rate_errors
from megalopta.sensor.compare.two_sample import difference, scene_differences

_SHIFTS_PER_FRAME = 4


@dataclass(frozen=True)
class CompareSettings:
    """Settings of a comparison."""

    scene: str = "levels"
    """"levels": darkness and uniform light; "plate": the plate of the motion bench; or the folder
    of a rendered dataset."""
    beam: Beam = field(default_factory=Beam)
    margin: float = MARGIN
    """Relative difference to ignore."""
    seed: int = 0
    """Seed of the simulation."""


def compare_captured(
    sources: Sequence[Source], device: Path, out: Path, settings: CompareSettings
) -> str:
    """Write the report, an HTML page; return the main differences in a sentence.

    Sources have a light each; for "plate", a speed (mm/s) instead; for a dataset, a light level
    (lux), 0: that of the rendering. Raises UserError if the device file or recordings cannot be
    read, or do not match.
    """
    with refused_as("compare"):
        sensor = IMAGE_SENSORS.get(str(device)) or load_sensor(device)
        if not isinstance(sensor, Sensor):
            raise UserError(f"--device {device}: compare takes counts of SPAD arrays, no electrons")
        if len(summed := {source.sums for source in sources}) > 1:
            raise UserError(f"sums: {summed}; compare recordings of one kind at a time")
        if (sums := summed.pop()) and sums != sensor.counter.sums:
            sensor = changed(sensor, counter={"sums": sums})
        captured: list[Level] = []
        note = ""
        for source in sources:
            light = source.light
            if settings.scene == "levels":
                light = settings.beam.photons_hz(light, sensor)
            with step(f"reading {source.path.name}"):
                frames = captured_frames(read_recorded(source), sensor, light)
            first = len(one_by_one(frames).readings)
            if settings.scene == "levels" and len(frames.readings) > first:
                many = len(frames.readings)
                note = f" Of {many} frames, the first {first} are compared one by one."
            captured.append(frames)
    with refused_as("compare"), step("simulating the same stimulus, and comparing"):
        if settings.scene == "levels":
            captured.sort(key=lambda level: (level.light_hz, level.exposure_s))
            nm, margin, seed = settings.beam.wavelength_nm, settings.margin, settings.seed
            comparison = compare_recordings(
                captured, sensor, wavelength_nm=nm, margin=margin, seed=seed
            )
            page = pages.levels_page(sensor.name, comparison)
        elif settings.scene == "plate":
            plates = {frames.light_hz: frames for frames in captured}
            responses = plate_responses(plates, sensor, settings)
            page = pages.motion_page(sensor.name, responses, settings.margin)
        else:
            dataset = Path(settings.scene)
            if not dataset.is_dir():
                raise UserError(
                    f"--scene: {dataset}; give levels, plate or the folder of a rendered dataset"
                )
            if len(captured) != 1:
                raise UserError(f"{len(sources)} recordings of {dataset}; give one at a time")
            lux = captured[0].light_hz
            cycle, scene = rendered(sensor, dataset, lux or None), replace(captured[0], light_hz=1)
            page = pages.scene_page(dataset.name, *_compare_scene(scene, cycle, sensor, settings))
    title, sentence, sections = page
    sentence = "".join([sentence, note, *(source.contradictions for source in sources)])
    write_sections(out, title, sentence, sections)
    return sentence


def captured_frames(recorded: RecordingFrames, device: Sensor, light_hz: float) -> Level:
    """Return counts of a recording; from its codes, if it has any, by the device's own steps."""
    codes, exposure_s, times_s = recorded.codes, recorded.exposure_s, recorded.times_s
    if codes is None or not isinstance(device.counter, AnalogCounter):
        return Level(recorded.counts, exposure_s, light_hz, times_s=times_s)
    return level_of_codes(codes, device, exposure_s, light_hz, times_s)


def plate_responses(
    captured: Mapping[float, Level], device: Sensor, settings: CompareSettings
) -> list[pages.SpeedResponse]:
    """Compare responses to a plate at each speed (mm/s), over complete passages.

    Passages are found by their edges, so that the plate may rest at its ends. Raises UserError if a
    recording is not of 16 × 16 pixels at 10 frames/s, or has fewer than two complete passages
    without a gap.
    """
    responses = []
    for speed, recorded in sorted(captured.items()):
        counts = passages_at(speed, recorded)
        sensor = changed(device, exposure_s=1 / motion_bench.FRAME_RATE_HZ)
        simulated = motion_bench.record(speed, sensor, settings.seed).counts
        for name, unit in motion_bench.UNITS.items():
            method = motion_bench.detector(name)
            peaks = [
                motion_bench.crossing_peaks(method, motion_bench.pooled(frames)).mean(axis=(1, 2))
                for frames in (counts, simulated)
            ]
            title = f"{name} response at {speed:g} mm/s"
            change = difference(title, unit, peaks[0], peaks[1], settings.margin)
            responses.append(pages.SpeedResponse(name, speed, peaks[0], peaks[1], change))
    return responses


def passages_at(speed_mm_s: float, frames: Level) -> NDArray[np.generic]:
    """Cut passages from a recording of a plate. Raises UserError."""
    if frames.readings.shape[1:] != (motion_bench.PIXELS, motion_bench.PIXELS):
        raise UserError(
            f"plate at {speed_mm_s:g} mm/s: frames of {frames.readings.shape[1:]} pixels; capture "
            "all rows"
        )
    times_s, numbers = frames.times_s, None
    if times_s is not None:
        numbers = np.rint((times_s - times_s[:1]) * motion_bench.FRAME_RATE_HZ)
    with refused_as(f"plate at {speed_mm_s:g} mm/s"):
        return motion_bench.cut_passages(frames.readings, numbers)


def _compare_scene(
    captured: Level, cycle: Cycle, device: Sensor, settings: CompareSettings
) -> tuple[Comparison, float]:
    """Align captured frames with a scene, and compare them; return their correlation, too."""
    shape, length = captured.readings.shape[1:], len(cycle.rates_hz)
    if shape != cycle.rates_hz.shape[1:]:
        raise UserError(
            f"compare: frames of {shape} pixels, the scene has {cycle.rates_hz.shape[1:]}; "
            "capture all rows"
        )
    times_s = captured.times_s
    assert times_s is not None
    # frame of the cycle at each captured frame, for every shift, (shifts, n)
    shift = np.arange(_SHIFTS_PER_FRAME * length) / _SHIFTS_PER_FRAME
    at = (times_s - times_s[0]) * cycle.frame_rate_hz + shift[:, None]
    frame = np.asarray(np.floor(at + 1e-6).astype(np.int64) % length)
    counts, rates = (
        (frames - frames.mean(axis=0)).reshape(len(frames), -1)
        for frames in (np.asarray(captured.readings, np.float64), cycle.rates_hz)
    )
    size = np.square(rates).sum(axis=1)
    fit = (counts @ rates.T)[np.arange(len(counts)), frame].sum(axis=1)
    norm = np.sqrt(np.square(counts).sum() * size[frame].sum(axis=1))
    correlation = fit / np.maximum(norm, 1e-300)  # 0 without motion
    best = np.flatnonzero(correlation >= correlation.max() - 1e-9)
    # the middle of equal shifts is the least sensitive to clock differences
    rates_hz = cycle.rates_hz[frame[best[len(best) // 2]]]
    model, margin = Model(device, [rates_hz]), settings.margin
    simulated = model.drawn([captured], settings.seed, "scene, ")
    errors_hz = rate_errors(device, rates_hz)
    errors = [errors_hz * captured.exposure_s]
    comparison = compare_levels(
        [captured], simulated, model, margin=margin, errors=errors, is_scene=True
    )
    differences = scene_differences(captured, simulated[0], rates_hz, margin, errors_hz)
    return replace(comparison, differences=differences), float(correlation.max())
