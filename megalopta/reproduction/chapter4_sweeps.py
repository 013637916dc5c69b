"""The sweeps of Chapter 4: §4.4 on gratings, §4.5 on natural panoramas, with every fixed parameter.

Unless a sweep varies it: contrast 90 %, spatial frequency 5 cycles per frame, 5 px per frame and
0.1 dark counts per pixel and frame. Pooling levels are those that text or captions name.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, Literal, NamedTuple

from megalopta.benchmark.panorama_recipes import NATURAL_PANORAMAS
from megalopta.benchmark.sweep import Sweep, Value
from megalopta.benchmark.templates import PanoramaTemplate
from megalopta.benchmark.trial import Trial
from megalopta.flow.benchmark.settings import SearchSettings

POOLING = (60, 120, 180, 240)
VELOCITIES = tuple(range(1, 11))
DARK_COUNTS = (0.1, 1.0, 10.0, 100.0, 1000.0)
"""Per pixel of the template"""

_FIXED = Trial(search=SearchSettings(bits=(2,), phases=3, frames=4))
_NATURAL = _FIXED.model_copy(
    update={"template": PanoramaTemplate(kind="panorama", name=next(iter(NATURAL_PANORAMAS)))}
)


class _Axis(NamedTuple):
    """What a sweep varies: its name, its path in a trial, its values, and the sizes."""

    name: str
    vary: str
    values: tuple[Value, ...]
    sizes: tuple[int, ...] = ()


_FREQUENCY = _Axis("spatial frequency", "template.cycles_per_frame", tuple(range(1, 10)), POOLING)
_CONTRAST = _Axis("contrast", "template.contrast", tuple(n / 10 for n in range(1, 10)), POOLING)
_DARK = _Axis("dark counts", "search.dark_counts", DARK_COUNTS, (240,))
_VELOCITY = _Axis("velocity", "velocity_px", VELOCITIES, (60, 240))
_POOLING = _Axis("spatial pooling", "size", POOLING)


def _gratings(heading: str, axis: _Axis, seen: str = "gratings") -> Sweep:
    """A sweep that is not checked: that makes all its trials, and few sweeps are asked for."""
    title = f"{heading} needed over {axis.name}, {seen}"
    return Sweep.model_construct(
        title=title, trial=_FIXED, vary=axis.vary, values=axis.values, sizes=axis.sizes
    )


def _forests(
    heading: str,
    axis: _Axis,
    seen: str = "natural scenes",
    blurred: bool = False,
    coding: Literal["linear", "srgb"] = "linear",
) -> Sweep:
    forests = tuple(
        PanoramaTemplate(kind="panorama", name=name, coding=coding) for name in NATURAL_PANORAMAS
    )
    changes = {"templates": forests, "trial": _NATURAL.model_copy(update={"blurred": blurred})}
    return _gratings(heading, axis, seen).model_copy(update=changes)


SWEEPS: Mapping[str, Sweep] = {
    "fig-4.5": _gratings("Figure 4.5: photons", _FREQUENCY),
    "fig-4.6": _gratings("Figure 4.6: photons", _CONTRAST),
    "fig-4.7": _gratings("Figure 4.7: photons", _DARK),
    "fig-4.8": _gratings("Figure 4.8: photons", _VELOCITY),
    "fig-4.9": _gratings("Figure 4.9: photons", _POOLING),
    "fig-4.10": _forests("Figure 4.10: photons", _DARK),
    "fig-4.11": _forests("Figure 4.11: photons", _VELOCITY),
    "fig-4.12": _forests(
        "Figure 4.12: photons", _VELOCITY, "natural scenes with motion blur", blurred=True
    ),
    "fig-4.13": _forests("Figure 4.13: photons", _POOLING),
}

PHOTOGRAPHED = _forests(
    "Photons", _VELOCITY._replace(sizes=(60,)), "photographs of natural scenes", coding="srgb"
)
"""The dissertation's panoramas are pictures from the web, whose gray values are no light."""


@cache
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
