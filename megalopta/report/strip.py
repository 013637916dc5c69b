"""First strip of the report: light, readings from bright to dark, the flow found, true motion."""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from PIL import Image

from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.flow.detectors.registry import velocity_method
from megalopta.plotting.sections import block
from megalopta.plotting.text import level_name
from megalopta.report.images import film
from megalopta.report.light_section import counts_film
from megalopta.report.motion_section import flow_film
from megalopta.report.sequence_panels import best_method, found_flow
from megalopta.report.source import Budget, Report, by_sensor
from megalopta.sensor import StoredFrames
from megalopta.stages.flow import responses_path

_MOST_LEVELS = 4


def strip(report: Report, sensor: str) -> Markup:
    """Return the strip of one sensor; nothing without readings."""
    own = by_sensor(report.exposures).get(sensor, [])
    if not own:
        return Markup("")
    brightest_first = sorted(own, key=lambda each: -each.illuminance_lux)
    chosen = _spread(brightest_first)
    films = [film(None, "light", "The scene's light, tone-mapped"), *map(counts_film, chosen)]
    return block("strip", *films, *_found(report, brightest_first[0]), flow_film(report))


def _spread(budgets: Sequence[Budget]) -> list[Budget]:
    count = min(len(budgets), _MOST_LEVELS)
    places = np.linspace(0, len(budgets) - 1, count).round().astype(int)
    return [budgets[place] for place in places]


def _found(report: Report, budget: Budget) -> list[Markup]:
    """Return the flow of the best method on the brightest readings; nothing if none ran."""
    level, sensor = budget.level, budget.sensor
    records = [each for each in report.flow if (each.sensor, each.level) == (sensor.name, level)]
    method = best_method(records)
    if method is None:
        return []
    stored = StoredFrames.open(responses_path(report.dataset, sensor, level), method)
    grid = velocity_method(method).grid(report.settings.camera.shape)
    step = report.selection.step
    flows = (found_flow(stored, grid, each)[::step, ::step] for each in report.selection.frames)
    images = [Image.fromarray(flow_to_rgb(each, report.fastest)) for each in flows]
    name = f"{method} at {level_name(level)}"
    return [film(images, name, f"Flow by {name}, colors as on the wheel")]
