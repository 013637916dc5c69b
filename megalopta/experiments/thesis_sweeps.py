"""The sweeps of Chapter 4: §4.4 on gratings, §4.5 on natural panoramas, with every fixed parameter.

Unless a sweep varies it: contrast 90 %, spatial frequency 5 cycles per frame, 5 px per frame and
0.1 dark counts per pixel and frame. Pooling levels are those that text or captions name.
"""

from collections.abc import Mapping
from typing import Any

from megalopta.experiments.panorama_recipes import NATURAL_PANORAMAS
from megalopta.experiments.sweep import Sweep
from megalopta.experiments.trial import PanoramaTemplate, Trial
from megalopta.flow.benchmark import SearchSettings

POOLING = (60, 120, 180, 240)
VELOCITIES = tuple(range(1, 11))
DARK_COUNTS = (0.1, 1.0, 10.0, 100.0, 1000.0)
"""Per pixel of the template"""

_FIXED = Trial(search=SearchSettings(bits=(2,), phases=3, frames=4))
_FOREST = tuple(PanoramaTemplate(kind="panorama", name=name) for name in NATURAL_PANORAMAS)
_NATURAL = _FIXED.model_copy(update={"template": _FOREST[0]})

SWEEPS: Mapping[str, Sweep] = {
    "fig-4.5": Sweep(
        title="Figure 4.5: photons needed over spatial frequency, gratings",
        trial=_FIXED,
        vary="template.cycles_per_frame",
        values=tuple(range(1, 10)),
        sizes=POOLING,
    ),
    "fig-4.6": Sweep(
        title="Figure 4.6: photons needed over contrast, gratings",
        trial=_FIXED,
        vary="template.contrast",
        values=tuple(step / 10 for step in range(1, 10)),
        sizes=POOLING,
    ),
    "fig-4.7": Sweep(
        title="Figure 4.7: photons needed over dark counts, gratings",
        trial=_FIXED,
        vary="search.dark_counts",
        values=DARK_COUNTS,
        sizes=(240,),
    ),
    "fig-4.8": Sweep(
        title="Figure 4.8: photons needed over velocity, gratings",
        trial=_FIXED,
        vary="velocity_px",
        values=VELOCITIES,
        sizes=(60, 240),
    ),
    "fig-4.9": Sweep(
        title="Figure 4.9: photons needed over spatial pooling, gratings",
        trial=_FIXED,
        vary="size",
        values=POOLING,
    ),
    "fig-4.10": Sweep(
        title="Figure 4.10: photons needed over dark counts, natural scenes",
        trial=_NATURAL,
        templates=_FOREST,
        vary="search.dark_counts",
        values=DARK_COUNTS,
        sizes=(240,),
    ),
    "fig-4.11": Sweep(
        title="Figure 4.11: photons needed over velocity, natural scenes",
        trial=_NATURAL,
        templates=_FOREST,
        vary="velocity_px",
        values=VELOCITIES,
        sizes=(60, 240),
    ),
    "fig-4.12": Sweep(
        title="Figure 4.12: photons needed over velocity, natural scenes with motion blur",
        trial=_NATURAL.model_copy(update={"blurred": True}),
        templates=_FOREST,
        vary="velocity_px",
        values=VELOCITIES,
        sizes=(60, 240),
    ),
    "fig-4.13": Sweep(
        title="Figure 4.13: photons needed over spatial pooling, natural scenes",
        trial=_NATURAL,
        templates=_FOREST,
        vary="size",
        values=POOLING,
    ),
}

PHOTOGRAPHED = Sweep(
    title="Photons needed over velocity, photographs of natural scenes",
    trial=_NATURAL,
    templates=tuple(forest.model_copy(update={"coding": "srgb"}) for forest in _FOREST),
    vary="velocity_px",
    values=VELOCITIES,
    sizes=(60,),
)
"""The dissertation's panoramas are pictures from the web, whose gray values are no light."""


def in_form(sweep: Sweep, is_quick: bool) -> Sweep:
    """Return a sweep, in quick form with the smallest frames, every third value and two forests."""
    if not is_quick:
        return sweep
    changes: dict[str, Any] = {"templates": sweep.templates[:2]}
    if sweep.vary == "size":
        changes |= {"values": sweep.values[:2]}
    else:
        changes |= {"values": sweep.values[::3], "sizes": POOLING[:1]}
    return sweep.model_copy(update=changes)
