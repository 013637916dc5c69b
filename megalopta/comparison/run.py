"""`megalopta spadcam compare`: a recording beside what the device's model makes of its stimulus."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from megalopta.calibration import Beam, Source, read_recorded
from megalopta.comparison.levels import calibration_errors, captured_frames, simulated_frames
from megalopta.comparison.motion import plate_responses
from megalopta.comparison.page import write_comparison_report, write_motion_report
from megalopta.errors import UserError
from megalopta.sensor import Sensor, load_sensor
from megalopta.sensor.compare import MARGIN, CountedFrames, compare_recordings

Scene = Literal["levels", "plate"]


def compare_captured(
    sources: Sequence[Source],
    device: Path,
    out: Path,
    *,
    scene: Scene = "levels",
    beam: Beam = Beam(),  # noqa: B008
    margin: float = MARGIN,
    seed: int = 0,
) -> str:
    """Write the report; return what differs and by how much in a sentence.

    Parameters
    ----------
    sources : sequence of Source
        Of the scene "levels" with their light, of "plate" with its speed (mm/s) in place of it.
    device : Path
        Device file, as `megalopta spadcam calibrate` writes it.
    out : Path
        HTML page.
    scene : "levels" or "plate"
        Darkness and even light, or the moving plate of the motion bench.
    beam : Beam
    margin : float
        Relative difference that does not matter.
    seed : int
        Of the simulation.

    Raises
    ------
    UserError
        When device or recordings cannot be read, or do not suit each other.
    """
    try:
        sensor = load_sensor(device)
        if scene == "plate":
            plates = {
                source.light: captured_frames(read_recorded(source), sensor, source.light)
                for source in sources
            }
            return write_motion_report(out, device.stem, plate_responses(plates, sensor, margin))
        captured = [_level(source, sensor, beam) for source in sources]
        simulated = simulated_frames(captured, sensor, beam, seed)
        kind = sensor.dead_time.kind
        errors = calibration_errors(captured, sensor, beam)
        found = compare_recordings(captured, simulated, kind=kind, margin=margin, errors=errors)
    except ValueError as problem:
        raise UserError(f"compare: {problem}") from problem
    write_comparison_report(out, device.stem, captured, simulated, found)
    return found.sentence


def _level(source: Source, sensor: Sensor, beam: Beam) -> CountedFrames:
    light = beam.photons_hz(source.light, sensor)
    return captured_frames(read_recorded(source), sensor, light)
