"""View of a dataset of one sequence, with its finished stages."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from megalopta.config.model import LightLevel
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.picture_light import photons_per_lux
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import exposure_name
from megalopta.plotting.text import level_name, number
from megalopta.report.images import evenly_spaced
from megalopta.report.page import title
from megalopta.report.readings import Treatment
from megalopta.report.seen import (
    SAMPLED,
    Exposed,
    Seen,
    fastest_of,
    flow_panel,
    readings_panel,
    step_of,
)
from megalopta.report.sequence_panels import (
    best_flow,
    exposure_readings,
    light_panel,
    motion_of,
)
from megalopta.report.source import finished_stages, read_records
from megalopta.scenes import Pictures
from megalopta.scenes.lighting.levels import illuminance_of
from megalopta.sensor import ImageSensor
from megalopta.stages.ledger import Ledger

_CAVEAT = " Their true motion is unknown; the flow of the clean pictures is a stand-in for it."


def seen_sequence(root: Path, treatment: Treatment) -> Seen:
    """Return the view of a dataset of one sequence.

    Raises UserError if it is damaged, not rendered yet, or does not allow the treatment.
    """
    return _Shown(open_dataset(root)[0], treatment).seen()


class _Shown:
    """A dataset of one sequence, with its finished stages."""

    def __init__(self, sequence: Sequence, treatment: Treatment) -> None:
        self.sequence, self.treatment = sequence, treatment
        settings, ledger = sequence.configuration, Ledger(sequence.dataset)
        if settings.scene.has_truth:
            ledger.require("render")
        finished = finished_stages(ledger)
        pairs = settings.exposures if "sense" in finished else ()
        self.pairs = sorted(pairs, key=lambda pair: illuminance_of(pair[1]))
        self.records = read_records(sequence.dataset) if "flow" in finished else []
        self.step = step_of(sequence.shape)
        # the last frame has no next frame, and so no motion
        end = min(len(sequence) - 1, len(sequence) - treatment.summed + 1)
        self.frames = range(0, max(end, 1), treatment.summed)

    def seen(self) -> Seen:
        """Return its view."""
        sequence, settings = self.sequence, self.sequence.configuration
        has_motion, (height, width) = len(sequence) > 1, sequence.shape
        rim = (
            fastest_of(map(self._motion, evenly_spaced(self.frames, SAMPLED)))
            if has_motion
            else None
        )
        name, caveat = "true flow", ""
        if not settings.scene.has_truth:
            name, caveat = "flow of the clean pictures", _CAVEAT
        return Seen(
            title=title(settings),
            summary=f"{len(sequence)} frames of {width} × {height} pixels.{caveat}",
            shape=sequence.shape,
            frames=self.frames,
            step=self.step,
            times_s=sequence.times_s,
            treatment=self.treatment,
            light=light_panel(sequence, self.frames, self.step),
            exposed=tuple(self._exposed(*pair, rim) for pair in self.pairs),
            motion=flow_panel(name, self._motion, rim) if rim else None,
            rim=rim,
            sequence=sequence,
        )

    def _motion(self, frame: int) -> NDArray[Any]:
        return motion_of(self.sequence, frame, self.step)

    def _exposed(self, sensor: ImageSensor, level: LightLevel, rim: float | None) -> Exposed:
        readings = exposure_readings(self.sequence, exposure_name(sensor, level), sensor)
        drawn = readings_panel(readings.treated(self.treatment), self.frames, self.step)
        dataset = self.sequence.dataset
        found = best_flow(dataset, self.records, sensor, level, self.step)
        flow = flow_panel(f"flow by {found[0]}", found[1], rim) if found and rim else None
        return Exposed(drawn, flow, sensor.name, self._level(level))

    def _level(self, level: LightLevel) -> str:
        """Return the name of a level; for pictures, with the photons of the first sensor."""
        settings = self.sequence.configuration
        scene, sensor = settings.scene, settings.sensors[0]
        if not isinstance(scene, Pictures):
            return level_name(level)
        mean = self.sequence.dataset.read_scene_record()["pictures"]["mean"]
        per_lux = photons_per_lux(scene, settings.light, settings.render.bands_nm, sensor, mean)
        photons = number(per_lux * illuminance_of(level))
        return f"{level_name(level)}, {photons} photons"
