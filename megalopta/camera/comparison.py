"""`megalopta spadcam compare`: a recording beside what the device's model makes of its stimulus."""

from collections.abc import Sequence
from pathlib import Path

from megalopta.camera.calibration import Beam
from megalopta.camera.comparison_cycle import dataset_cycle, rendered_dataset
from megalopta.camera.comparison_levels import calibration_errors, captured_frames, simulated_frames
from megalopta.camera.comparison_motion import plate_responses
from megalopta.camera.comparison_page import (
    write_comparison_report,
    write_motion_report,
    write_scene_report,
)
from megalopta.camera.moving import compare_scene
from megalopta.camera.recorded import Source, read_recorded
from megalopta.core.errors import UserError
from megalopta.sensor import Sensor, load_sensor
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.sensor.compare.recordings import MARGIN, compare_recordings


def compare_captured(
    sources: Sequence[Source],
    device: Path,
    out: Path,
    *,
    scene: str = "levels",
    beam: Beam = Beam(),  # noqa: B008
    margin: float = MARGIN,
    seed: int = 0,
    own_light: bool = False,
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
            responses = plate_responses(plates, sensor, margin, seed, own_light=own_light)
            return write_motion_report(out, device.stem, responses)
        if scene != "levels":
            dataset = rendered_dataset(scene, out.with_suffix(""))
            return _of_dataset(sources, sensor, dataset, out, margin, seed)
        captured = [_level(source, sensor, beam) for source in sources]
        simulated = simulated_frames(captured, sensor, beam, seed)
        kind = sensor.dead_time.kind
        errors = calibration_errors(captured, sensor, beam)
        found = compare_recordings(captured, simulated, kind=kind, margin=margin, errors=errors)
    except ValueError as problem:
        raise UserError(f"compare: {problem}") from problem
    write_comparison_report(out, device.stem, captured, simulated, found)
    return found.sentence


def _of_dataset(
    sources: Sequence[Source], sensor: Sensor, dataset: Path, out: Path, margin: float, seed: int
) -> str:
    if len(sources) != 1:
        raise UserError(f"compare: {len(sources)} recordings of {dataset}; give one at a time")
    (source,) = sources
    captured = captured_frames(read_recorded(source), sensor, source.light or 1.0)
    cycle = dataset_cycle(dataset, source.light or None, sensor)
    compared = compare_scene(captured, cycle, sensor, margin, seed)
    write_scene_report(out, dataset.name, compared)
    return compared.found.sentence


def _level(source: Source, sensor: Sensor, beam: Beam) -> CountedFrames:
    light = beam.photons_hz(source.light, sensor)
    return captured_frames(read_recorded(source), sensor, light)
