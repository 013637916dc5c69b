"""`megalopta spadcam compare`: a recording beside what the device's model makes of its stimulus."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from megalopta.camera.comparison_levels import calibration_errors, captured_frames, simulated_frames
from megalopta.camera.comparison_motion import plate_responses
from megalopta.camera.comparison_page import (
    write_comparison_report,
    write_motion_report,
    write_scene_report,
)
from megalopta.camera.comparison_scene import compare_scene, dataset_cycle, rendered_dataset
from megalopta.camera.device_calibration import Beam
from megalopta.camera.recorded import Source, read_recorded
from megalopta.core.errors import UserError
from megalopta.sensor import Sensor, load_sensor
from megalopta.sensor.compare.recordings import MARGIN, compare_recordings


@dataclass(frozen=True)
class CompareSettings:
    """Settings of a comparison.

    Attributes
    ----------
    scene : str
        "levels": darkness and even light; "plate": the moving plate of the motion bench; else the
        folder of a dataset, or a configuration, which is rendered into a folder beside the page.
    beam : Beam
    margin : float
        Relative difference that does not matter.
    seed : int
        Of the simulation.
    own_light : bool
        Of the scene "plate": whether to simulate in the light that each recording shows, instead
        of the dissertation's.
    """

    scene: str = "levels"
    beam: Beam = field(default_factory=Beam)
    margin: float = MARGIN
    seed: int = 0
    own_light: bool = False


def compare_captured(
    sources: Sequence[Source], device: Path, out: Path, asked: CompareSettings
) -> str:
    """Write the report; return what differs and by how much in a sentence.

    Parameters
    ----------
    sources : sequence of Source
        Of the scene "levels" with their light; of "plate" with its speed (mm/s) in place of it, of
        a dataset with the light level (lux), 0: that of the rendering.
    device : Path
        Device file, as `megalopta spadcam calibrate` writes it.
    out : Path
        HTML page.
    asked : CompareSettings

    Raises
    ------
    UserError
        When device or recordings cannot be read, or do not suit each other.
    """
    try:
        sensor = load_sensor(device)
        if asked.scene == "plate":
            return _with_plate(sources, sensor, out, asked)
        if asked.scene != "levels":
            return _with_scene(sources, sensor, out, asked)
        return _with_levels(sources, sensor, out, asked)
    except ValueError as problem:
        raise UserError(f"compare: {problem}") from problem


def _with_levels(
    sources: Sequence[Source], sensor: Sensor, out: Path, asked: CompareSettings
) -> str:
    beam = asked.beam
    captured = [
        captured_frames(read_recorded(source), sensor, beam.photons_hz(source.light, sensor))
        for source in sources
    ]
    simulated = simulated_frames(captured, sensor, beam, asked.seed)
    errors = calibration_errors(captured, sensor, beam)
    kind = sensor.dead_time.kind
    found = compare_recordings(captured, simulated, kind=kind, margin=asked.margin, errors=errors)
    write_comparison_report(out, sensor.name, captured, simulated, found)
    return found.sentence


def _with_plate(
    sources: Sequence[Source], sensor: Sensor, out: Path, asked: CompareSettings
) -> str:
    plates = {
        source.light: captured_frames(read_recorded(source), sensor, source.light)
        for source in sources
    }
    responses = plate_responses(plates, sensor, asked.margin, asked.seed, own_light=asked.own_light)
    return write_motion_report(out, sensor.name, responses)


def _with_scene(
    sources: Sequence[Source], sensor: Sensor, out: Path, asked: CompareSettings
) -> str:
    dataset = rendered_dataset(asked.scene, out.with_suffix(""))
    if len(sources) != 1:
        raise UserError(f"compare: {len(sources)} recordings of {dataset}; give one at a time")
    (source,) = sources
    captured = captured_frames(read_recorded(source), sensor, source.light or 1.0)
    cycle = dataset_cycle(dataset, source.light or None, sensor)
    compared = compare_scene(captured, cycle, sensor, asked.margin, asked.seed)
    write_scene_report(out, dataset.name, compared)
    return compared.found.sentence
