"""`megalopta spadcam figures`: recordings of the plate into figures 2.14 to 2.19."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.comparison_levels import captured_frames
from megalopta.camera.motion_bench import FRAME_RATE_HZ
from megalopta.camera.passages import cut_passages, cut_rest, fitted_light
from megalopta.camera.recorded import Source, read_recorded
from megalopta.camera.recording import Recording, open_recording
from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import working
from megalopta.plotting.picture import write_figure
from megalopta.reproduction.chapter2_captured import captured_figures
from megalopta.sensor import Sensor, changed, load_sensor


def reproduce_captured(
    sources: Sequence[Source], out: Path, device: Path | None = None, *, own_light: bool = False
) -> Iterator[Path]:
    """Draw figures 2.14 to 2.19 from recordings beside those simulated; yield their files' paths.

    Parameters
    ----------
    sources : sequence of Source
        Recordings of the plate, with its speed (mm/s) in place of the light; several of one speed
        are taken together.
    out : Path
        Made if it does not exist; files of the same name are replaced, each as a whole.
    device : Path, optional
        Device file that simulates, and whose steps turn codes into counts; by default the nominal
        sensor of the recordings, through the nominal step.
    own_light : bool
        Whether to simulate in the light that the recording of the slowest plate shows, instead of
        the dissertation's.

    Raises
    ------
    UserError
        When device or recordings cannot be read, or show no passages; nothing is written then.
    """
    if not any(source.light > 0 for source in sources):
        raise UserError(
            "figures: only a plate at rest; give recordings with its speed, such as a@5"
        )
    opened = [_opened(source.path) for source in sources]
    sensor = _sensor(opened, device)
    cut: dict[float, list[NDArray[Any]]] = {}
    for source, recording in zip(sources, opened, strict=True):
        counts = _counts(source, recording, sensor if device else None)
        cut.setdefault(source.light, []).append(_cut(source, recording, counts))
    captured = {speed: np.concatenate(parts) for speed, parts in cut.items()}
    light = None
    if own_light:
        slowest = min(speed for speed in captured if speed > 0)
        try:
            light = fitted_light(captured[slowest], sensor)
        except ValueError as problem:
            raise UserError(f"plate at {slowest:g} mm/s: {problem}") from problem
    ensure_directory(out)
    with working("figures"):
        for figure in captured_figures(captured, sensor, light):
            yield from write_figure(figure, out)


def _opened(path: Path) -> Recording:
    try:
        recording = open_recording(path)
    except (OSError, ValueError) as problem:
        raise UserError(str(problem)) from problem
    settings = recording.settings
    timing = settings.frame_rate_hz * np.array([1, settings.exposure_s])
    if not np.allclose(timing, (FRAME_RATE_HZ, 1), rtol=0.01):
        raise UserError(
            f"{path}: {settings.frame_rate_hz:g} frames/s of {settings.exposure_s:g} s; capture "
            f"with --rate {FRAME_RATE_HZ:g} --exposure {1 / FRAME_RATE_HZ:g}"
        )
    return recording


def _sensor(opened: Sequence[Recording], device: Path | None) -> Sensor:
    first, *others = opened
    for other in others:
        if other.sensor != first.sensor:
            raise UserError(
                f"{other.path}: another sensor or step than in {first.path}; give recordings with "
                "the same settings"
            )
    if device is None:
        return changed(first.sensor, counter={"calibrated": False})
    try:
        return changed(load_sensor(device), exposure_s=first.exposure_s)
    except (OSError, ValueError) as problem:
        raise UserError(f"--device: {problem}") from problem


def _counts(source: Source, recording: Recording, device: Sensor | None) -> NDArray[Any]:
    if device is None:
        return np.asarray(recording.counts[:])
    return captured_frames(read_recorded(source), device, 0.0).counts


def _cut(source: Source, recording: Recording, counts: NDArray[Any]) -> NDArray[Any]:
    try:
        if source.light:
            return cut_passages(counts, recording.sequence_number)
        return cut_rest(counts)
    except ValueError as problem:
        raise UserError(f"{source.path}: {problem}") from problem
