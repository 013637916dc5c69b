"""The ranking as a page, a table and JSON."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from megalopta import files
from megalopta.arrays import Floats
from megalopta.dataset import Dataset
from megalopta.pages import Section, number, write_sections
from megalopta.ranking.charts import atlas, error_curves, flow_fields, pooling_grid
from megalopta.ranking.errors import STILL
from megalopta.ranking.pooling import Pooling
from megalopta.ranking.run import Ranking
from megalopta.ranking.truth import DISTANCES_M, PARALLAX_PX, SPEEDS_PX
from megalopta.ranking.velocities import Drawn, Velocities

_GROUPS = ("all", "visible", "occluded", "smooth", "depth edge", "parallax low", "parallax high")
_OPPOSED = (
    ("parallax low", "parallax high", "parallax"),
    ("visible", "occluded", "occlusion"),
    ("smooth", "depth edge", "edges of depth"),
    ("speed low", "speed high", "speed"),
)


def write_ranking(folder: Path, ranking: Ranking, datasets: Sequence[Dataset], kept: Path) -> Path:
    """Write ranking.html, ranking.csv and ranking.json to a folder; return the page."""
    finest = finest_pooling(ranking)
    files.write_text(folder / "ranking.csv", _csv(ranking))
    files.write_json(folder / "ranking.json", _json(ranking))
    frames = sum(each.configuration.trajectory.frames for each in datasets)
    sections = [
        Section(
            "What was measured",
            f"{len(datasets)} sequence{'s'[: len(datasets) > 1]}, {frames} frames, perfect pixels. "
            "Errors are those of blocks against the true motion, in px of the full image per "
            "frame; a block without an answer counts as one that answered 0. Bands hold the mean "
            f"in 95 % of cases, over pairs of frames. Speed is low below {SPEEDS_PX[0]:g} px, high "
            f"above {SPEEDS_PX[1]:g} px; parallax, what is left of the motion without the camera's "
            f"rotation, below {PARALLAX_PX[0]:g} and above {PARALLAX_PX[1]:g} px; distance below "
            f"{DISTANCES_M[0]:g} and above {DISTANCES_M[1]:g} m.",
            ("group", "blocks"),
            tuple((name, str(count)) for name, count in ranking.blocks.items() if "," not in name),
        ),
        Section("Where the ranking changes", " ".join(findings(ranking))),
        Section(
            "Errors over photons",
            "The Poisson bound is the least error of an unbiased method that sees one block at a "
            "time, of known texture, or the motion itself where that is less: methods that share "
            "evidence between blocks may lie below it.",
            charts=tuple(
                error_curves(ranking, finest, group) for group in _GROUPS if ranking.blocks[group]
            ),
        ),
        Section(
            "Pooling",
            "Photons added over squares of pixels and over frames. Pale cells: within the noise "
            "of the measurement another method may be the best.",
            charts=(pooling_grid(ranking),),
        ),
        Section(
            "Atlas",
            "The best method without pooling. Gray: none beats the answer 0. Pale: not sure. "
            "White: not measured.",
            charts=(atlas(ranking, photons_per_lux_s(datasets)),),
        ),
        Section("Flow fields", _FIELDS, charts=(_fields(ranking, datasets[0], kept),)),
        _camera(ranking),
        _consistency(ranking),
    ]
    page = folder / "ranking.html"
    write_sections(page, "Flow methods on rendered sequences", _summary(ranking), sections)
    return page


_FIELDS = (
    "One pair of frames in the middle of the first sequence: hue is direction, saturation speed; "
    "mid gray is no answer."
)


def finest_pooling(ranking: Ranking) -> Pooling:
    """Return the least pooling that was measured."""
    return Pooling(min(ranking.settings.pixels_pooled), min(ranking.settings.frames_pooled))


def findings(ranking: Ranking) -> list[str]:
    """Say where the best method is another one for two groups, if the data can tell both."""
    finest, found = finest_pooling(ranking), []
    for one, other, what in _OPPOSED:
        changes = []
        for flux in sorted(ranking.settings.fluxes):
            a, b = (ranking.best.get((finest, flux, group)) for group in (one, other))
            if a and b and a.is_sure and b.is_sure and a.method != b.method:
                changes.append(
                    f"at {number(flux)} photons {a.method} where it is {one}, {b.method} where it "
                    f"is {other}".replace(f"it is {what} ", f"{what} is ")
                )
        changed = "; ".join(changes)
        found.append(
            f"The best method changes with {what}: {changed}."
            if changes
            else f"No change of the best method with {what} is beyond the noise."
        )
    return found


def photons_per_lux_s(datasets: Sequence[Dataset]) -> float:
    """Photons of a frame on perfect pixels for each lux and second, the mean of all sequences."""
    found = [
        Velocities.photons_per_s(each) / each.configuration.light.resolved().illuminance_lux
        for each in datasets
    ]
    return float(np.mean(found))


def _summary(ranking: Ranking) -> str:
    finest, words = finest_pooling(ranking), []
    for flux in sorted(ranking.settings.fluxes):
        best = ranking.best.get((finest, flux, "all"))
        if best is not None:
            sure = "" if best.is_sure else " (not sure)"
            what = "no method beats the answer 0" if best.method == STILL else best.method
            words.append(f"{number(flux)}: {what}{sure}")
    return f"Lowest mean error by photons per frame: {', '.join(words)}."


def _fields(ranking: Ranking, dataset: Dataset, kept: Path) -> Any:
    settings, finest = ranking.settings, finest_pooling(ranking)
    velocities = Velocities(dataset, settings, kept / dataset.sequence)
    truth = velocities.truth(settings.methods[0], finest).at(finest)
    fluxes = sorted(settings.fluxes)
    pair = len(truth.velocities) // 2
    fields: Mapping[str, list[Floats]] = {
        "truth": [truth.velocities[pair]],
        **{
            name: [velocities.of(name, Drawn(finest, flux, 0))[pair, 1:-1, 1:-1] for flux in fluxes]
            for name in settings.methods
        },
    }
    speed = float(np.nanquantile(np.linalg.norm(truth.velocities, axis=-1), 0.98)) or 1.0
    return flow_fields(fields, fluxes, speed)


def _camera(ranking: Ranking) -> Section:
    fluxes = sorted(ranking.settings.fluxes)
    rows = []
    for name in ranking.settings.methods:
        cells = [ranking.camera.get((flux, name)) for flux in fluxes]
        texts = [
            "–" if each is None else f"{_degrees(each.rotation_deg)}, {_degrees(each.heading_deg)}"
            for each in cells
        ]
        rows.append((name, *texts))
    return Section(
        "The camera's motion",
        "From the velocities of all blocks of a pair of frames: angle between the estimated and "
        "the true rotation, and between the estimated and the true direction of translation "
        f"(medians of {ranking.settings.camera_pairs} pairs of each sequence).",
        ("method", *(f"{number(flux)} photons" for flux in fluxes)),
        tuple(rows),
    )


def _degrees(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2g}°"


def _consistency(ranking: Ranking) -> Section:
    fluxes, finest = sorted(ranking.settings.fluxes), finest_pooling(ranking)
    return Section(
        "Agreement with itself",
        "Error against the same method's answer to the light without noise (Eq. 4.5): it says "
        "how well an answer repeats, not whether it is true.",
        ("method", *(f"{number(flux)} photons" for flux in fluxes)),
        tuple(
            (name, *(_percent(ranking.consistency[finest, flux, name]) for flux in fluxes))
            for name in ranking.settings.methods
        ),
    )


def _percent(value: float) -> str:
    return "–" if math.isnan(value) else f"{100 * value:.3g} %"


def _csv(ranking: Ranking) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = "pixels_pooled frames_pooled photons_per_frame group method epe_px low_px high_px"
    writer.writerow(names.split())
    for (pooling, flux, group, name), each in ranking.errors.items():
        writer.writerow([*pooling, f"{flux:g}", group, name, *(f"{value:.6g}" for value in each)])
    return text.getvalue()


def _json(ranking: Ranking) -> dict[str, Any]:
    return {
        "settings": ranking.settings.model_dump(mode="json"),
        "sequences": list(ranking.sequences),
        "blocks": dict(ranking.blocks),
        "errors": [
            {**_case(key), "group": key[2], "method": key[3], **each._asdict()}
            for key, each in ranking.errors.items()
        ],
        "best": [
            {**_case(key), "group": key[2], **each._asdict()} for key, each in ranking.best.items()
        ],
        "consistency": [
            {**_case(key), "method": key[2], "error": _number(each)}
            for key, each in ranking.consistency.items()
        ],
        "camera": [
            {"photons_per_frame": key[0], "method": key[1]}
            | {name: _number(value) for name, value in each._asdict().items()}
            for key, each in ranking.camera.items()
        ],
    }


def _case(key: Sequence[Any]) -> dict[str, Any]:
    return {**key[0]._asdict(), "photons_per_frame": key[1]}


def _number(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
