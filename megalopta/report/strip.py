"""First strip of the report: light, readings from bright to dark, the flow found, true motion."""

from markupsafe import Markup
from PIL import Image

from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.plotting.sections import block
from megalopta.plotting.text import level_name
from megalopta.report.images import film
from megalopta.report.light_section import counts_film
from megalopta.report.motion_section import flow_film
from megalopta.report.selection import with_ends
from megalopta.report.sequence_panels import best_flow
from megalopta.report.source import Budget, Report, by_sensor

_MOST_LEVELS = 4


def strip(report: Report, sensor: str) -> Markup:
    """Return the strip of one sensor; nothing without readings."""
    own = by_sensor(report.exposures).get(sensor, [])
    if not own:
        return Markup("")
    brightest_first = sorted(own, key=lambda each: -each.illuminance_lux)
    films = [
        film(None, "light", "The scene's light, tone-mapped"),
        *map(counts_film, with_ends(brightest_first, _MOST_LEVELS)),
    ]
    return block("strip", *films, *_found(report, brightest_first[0]), flow_film(report))


def _found(report: Report, budget: Budget) -> list[Markup]:
    """Return the flow of the best method on the brightest readings; nothing if none ran."""
    shown, level = report.selection, budget.level
    found = best_flow(report.dataset, report.flow, budget.sensor, level, shown.step)
    if found is None:
        return []
    method, flow = found
    images = [Image.fromarray(flow_to_rgb(flow(each), report.fastest)) for each in shown.frames]
    name = f"{method} at {level_name(level)}"
    return [film(images, name, f"Flow by {name}, colors as on the wheel")]
