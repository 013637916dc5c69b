"""The comparison report."""

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from megalopta.camera.comparison_charts import response_chart, time_chart
from megalopta.camera.comparison_motion import SpeedResponse
from megalopta.camera.moving import SceneComparison
from megalopta.camera.pixel_sections import pixel_sections
from megalopta.plotting.sections import Section, captioned, write_sections
from megalopta.plotting.text import number
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.sensor.compare.equivalence import Difference
from megalopta.sensor.compare.recordings import Comparison

Levels = Sequence[CountedFrames]

_HEAD = ("", "captured", "simulated", "difference", "95 %", "p", "verdict")


def write_comparison_report(
    path: Path, name: str, captured: Levels, simulated: Levels, found: Comparison
) -> None:
    """Write how captured levels differ from simulated ones, with pictures."""
    order = found.arrangement
    rows = f" Rows, top to bottom: {', '.join(map(str, order.rows))}." if order.rows else ""
    sections = [
        Section(
            "The device",
            f"Alarms are raised in at most {100 * found.false_alarms:g} % of comparisons of a "
            f"device with itself; less than {100 * found.margin:g} % does not matter: “equivalent” "
            "is what is surely less (two one-sided tests at 95 %).",
            _HEAD,
            tuple(_row(each, found) for each in found.differences),
        ),
        Section(
            "Order of the pixels",
            f"The captured image is {order.name}: rank correlation of the two patterns "
            f"{order.correlation:.3f}.{rows}",
        ),
        *pixel_sections(captured, simulated, found),
    ]
    write_sections(path, f"{name}: captured and simulated", found.sentence, sections)


def write_scene_report(path: Path, name: str, compared: SceneComparison) -> None:
    """Write how a captured scene differs from a simulated one, with pictures."""
    found = compared.found
    sections = [
        Section(
            "The scene",
            f"Frames are aligned in time by their correlation, {compared.aligned.correlation:.2f}, "
            "and each is simulated as it was seen. Quantities are compared in blocks of frames; "
            f"less than {100 * found.margin:g} % does not matter.",
            _HEAD,
            tuple(_row(each, found) for each in found.differences),
        ),
        Section("In time", charts=(_in_time(compared),)),
        *pixel_sections([compared.captured], [compared.simulated], found),
    ]
    write_sections(path, f"{name}: captured and simulated", found.sentence, sections)


def write_motion_report(path: Path, name: str, responses: Sequence[SpeedResponse]) -> str:
    """Write how responses to a moving plate differ; return the sentence on it."""
    limit = 0.01 / len(responses)
    real = [each.difference for each in responses if each.difference.p < limit]
    real.sort(key=lambda each: -each.size)
    sentence = (
        f"Captured: {'; '.join(map(str, real[:3]))}." if real else "Nothing differs beyond chance."
    )
    rows = tuple(_cells(each.difference, each.difference.p < limit) for each in responses)
    charts = tuple(_transfer(responses, method) for method in ("NDM", "NDS"))
    sections = [
        Section(
            "Transfer functions",
            "Mean and standard deviation of crossings. Of captured frames, 32 around each edge "
            "that passes are taken.",
            charts=charts,
        ),
        Section("Responses", "Peak responses to the edge.", _HEAD, rows),
    ]
    write_sections(path, f"{name}: responses to a moving plate", sentence, sections)
    return sentence


def _in_time(compared: SceneComparison) -> Markup:
    return captioned(
        time_chart(compared.captured, compared.simulated),
        "Curves that run together saw the same frames of the scene; one beside the other is "
        "another moment, one above the other another brightness.",
    )


def _transfer(responses: Sequence[SpeedResponse], method: str) -> Markup:
    return captioned(
        response_chart(responses, method),
        "The device sees motion as its model does where captured points lie on simulated ones; how "
        "sure that is, is in the table.",
    )


def _row(each: Difference, found: Comparison) -> tuple[str, ...]:
    limit = found.false_alarms / 5 / max(len(found.differences), 1)
    return _cells(each, each.p < limit)


def _cells(each: Difference, differs: bool) -> tuple[str, ...]:
    verdict = " and ".join(
        word for word, holds in (("differs", differs), ("equivalent", each.is_equivalent)) if holds
    )
    return (
        f"{each.name} ({each.unit})",
        number(each.captured),
        number(each.expected),
        f"{100 * each.relative:+.2g} %{each.base}",
        f"{100 * each.low:+.2g} to {100 * each.high:+.2g} %",
        f"{each.p:.2g}",
        verdict or "not told apart",
    )
