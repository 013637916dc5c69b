"""The last sections of the report: which method is best, the glossary, and how it was made."""

from markupsafe import Markup

from megalopta.benchmark.ranking_charts import atlas
from megalopta.benchmark.ranking_page import best_methods, order_changes
from megalopta.benchmark.ranking_run import FOLDER, read_ranking
from megalopta.config.yaml_model import to_yaml
from megalopta.generation import versions
from megalopta.plotting.sections import Section, block, card, folded, listed, paragraph
from megalopta.plotting.text import duration
from megalopta.report.remarks import rendering, rendering_errors
from megalopta.report.source import Report

_GLOSSARY = {
    "Radiance": "light that comes from a place in a direction, per area, solid angle and "
    "wavelength (W·m⁻²·sr⁻¹·nm⁻¹); no sensor has a part in it.",
    "Illuminance": "light on a level surface under the open sky as an eye weighs it (lux).",
    "Photons": "mean number on a pixel in one exposure, of which its efficiency detects a share.",
    "Events": "detections that reach a pixel's counter, dark counts, afterpulses and crosstalk "
    "included, without what dead time loses.",
    "Reading": "what a counter shows, which may be full, wrap around or have an offset.",
    "Shot noise": "scatter of photon counts about their mean, the root of which it is.",
    "Dark counts": "detections without a photon, at a rate of its own in every pixel.",
    "Dead time": "time after a detection in which a pixel detects nothing.",
    "Saturated": "a full pixel, whose reading is a lower bound.",
    "Corrected": "readings after dark counts, dead time, counter, flat field and hot pixels were "
    "taken out.",
    "True motion": "where the point that a pixel's center sees goes from one frame to the next "
    "(px of the image, to the right and down).",
    "Occluded": "hidden, or out of view, in the other frame.",
    "Parallax": "what is left of the motion without the camera's rotation: near things move more.",
    "Endpoint error (EPE)": "distance between a velocity and the true one (px).",
    "N_2b": "photons per frame, on all pixels together, at which a detector's error is 25 %: "
    "2 bits.",
    "Standing error": "part of the rendered light's error that is the same in all frames and "
    "moves with the surfaces.",
}

_RANKING = (
    "Endpoint error against the true motion, on perfect pixels that get as many photons as "
    "illuminance and exposure bring. {} {} This holds for this scene, this path and these "
    "settings; all curves, poolings and the camera’s motion are in {}/ranking.html beside this "
    "page."
)
_ATLAS = (
    "Gray: no method beats zero motion. Pale: within the noise of the measurement another may be "
    "the best. White: not measured."
)
_MADE = (
    "Everything on this page follows from the settings below and the seeds in them. Rendering is "
    "the only stage whose noise may differ between machines, within its statistics."
)
_FILES = """
dataset.yaml                 all settings and the version that made it
sequences/SEQ.json           of each stage what it was made with, and every file's hash
timings.json                 seconds each stage took
training/clean, final        tone-mapped radiance; counts of the first sensor and level (PNG)
training/flow                true motion to the next frame (.flo, px)
training/occlusions, invalid pixels without a match, without defined motion (PNG)
training/depth, camdata_left depth (.dpt, m) and camera (.cam)
radiance                     spectral radiance, W·m⁻²·sr⁻¹·nm⁻¹ per band (EXR)
truth                        motion both ways, depth, normals, objects, occlusion (EXR)
radiance_shutter             radiance through the shutter, which sensors see, if it has one (EXR)
truth_shutter                truth of every row at its own time, if rows have theirs (EXR)
counts                       counts, noise-free twin and saturation per sensor and level (Zarr)
results                      responses (Zarr), errors and photon benchmark (JSON, CSV)"""


def ranking_section(report: Report) -> Section | None:
    """Return the ranking against the true motion; None where it was not made."""
    ranking = read_ranking(report.dataset.root / FOLDER)
    if ranking is None:
        return None
    return Section(
        "Which method is best",
        _RANKING.format(best_methods(ranking), " ".join(order_changes(ranking)), FOLDER),
        body=block("card", atlas(ranking)) + paragraph(_ATLAS, "note"),
        name="ranking",
        link="Which is best",
    )


def glossary_section(report: Report) -> Section:
    """Return what each word of the report means."""
    return Section("Glossary", body=listed("words", _GLOSSARY.items()), name="words")


def making_section(report: Report) -> Section:
    """Return times, versions, settings and files."""
    samples = f"Light paths per pixel: {report.settings.render.samples_per_pixel}; four times as "
    remark = rendering(report.scene, f"{samples}many halve what is new in every frame.")
    variant = f"Rendered with Mitsuba’s variant {report.scene.get('variant', 'not noted')}."
    total = duration(sum(report.timings.values()))
    body = [
        remark,
        listed("versions", rendering_errors(report.scene)),
        block(
            "pair",
            card(f"Time spent: {total}", _bars(report), paragraph(variant, "note")),
            card(
                "Versions where this report was written",
                listed("versions", versions.versions().items()),
            ),
        ),
        folded("All settings", Markup("<pre>{}</pre>").format(to_yaml(report.settings))),
        folded("Files", Markup("<pre>{}</pre>").format(_FILES)),
    ]
    return Section("How it was made", _MADE, body=Markup("\n").join(body), name="made")


def _bars(report: Report) -> Markup:
    longest = max(report.timings.values(), default=0.0) or 1.0
    bar = Markup('<span>{}</span><i style="width:{:.1f}%"></i><span>{}</span>')
    bars = (
        bar.format(stage, 100 * spent / longest, duration(spent))
        for stage, spent in report.timings.items()
    )
    return block("bars", *bars)
