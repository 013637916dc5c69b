"""Faults composed at random: what changes, where, when and how strongly (`own_cameras`).

**Strength**: weak, middle, strong. A change of rates by a factor has 12, 40 or 130 standard errors
in the most natural statistic: all affected readings; of few lines or pixels one of them; of random
frames one frame. It is not smaller than what a comparison may neglect (5 % of what is steady).
Other changes have three stated sizes. A recipe whose weak form cannot be seen is not drawn.
"""

from itertools import product
from tempfile import TemporaryDirectory

import numpy as np

from megalopta.sensor.compare.model import Model
from megalopta.sensor.compare.recordings import compare_levels

from .changes import RATES, READINGS, moment_of, part_of, scaled
from .faulty import said
from .judgment import KINDS, Recipe, judged
from .own_cameras import CAMERAS, EFFICIENCY, Capture, calibrated, device_of, draw_maps

STRENGTHS = "weak", "middle", "strong"


def _size(recipe, strength, on):
    """Relative change of rates that has 12, 40 or 130 standard errors, or the stated size."""
    camera, what, where, when = recipe
    deviations = (12, 40, 130)[strength]
    if what.endswith("lag"):
        return np.clip(deviations / np.sqrt(2 * on.sum()), KINDS[what].sizes[strength], 0.6)
    if KINDS[what].sizes:
        return KINDS[what].sizes[strength]
    dark, *_, (exposure_s, light_hz, _) = CAMERAS[camera][1]
    counts = exposure_s * light_hz * EFFICIENCY
    if what.endswith("dark"):
        counts = dark[0] * (100 if camera == "codes" else 500)
    if camera == "bits":
        counts = counts**2 / np.expm1(counts)
    frames, pixels = on.any(axis=(1, 2)).sum(), on.any(axis=0).sum()
    frames = 1 if when == "random" else frames
    pixels = pixels / {"few rows": 2, "few columns": 2, "pixels": 8}.get(where, 1)
    size = deviations / np.sqrt(counts * frames * pixels)
    least = 0.02 if when != "always" or " of " in what else 0.08
    return max(size, least * (1, 2.5, 6)[strength])


def _mask(recipe, strength, rng):
    shape = CAMERAS[recipe.camera][0]
    return part_of(recipe.where, shape, rng) & moment_of(recipe.when, strength, rng)


def recipes():
    """All recipes of one fault whose weak form can be seen."""
    rng, seen = np.random.default_rng(0), []
    for what, kind in KINDS.items():
        for parts in product(kind.cameras, (what,), kind.where, kind.when):
            recipe = Recipe(*parts)
            is_seen = kind.sizes or _size(recipe, 0, _mask(recipe, 0, rng)) <= 1
            # a few readings of few pixels are not
            is_rare = recipe.where == "pixels" and recipe.when in ("every", "random")
            if is_seen and not (is_rare and what.startswith("stuck")):
                seen.append(recipe)
    return seen


def compose(number, *, reserved, camera=""):
    """Draw a recipe, of those that are reserved or not: camera, kind, then place and time."""
    rng = np.random.default_rng(number)
    known = [recipe for recipe in recipes() if recipe.is_reserved == reserved]
    camera = camera or rng.choice(list(CAMERAS))
    known = [recipe for recipe in known if recipe.camera == camera]
    what = rng.choice(sorted({recipe.what for recipe in known}))
    known = [recipe for recipe in known if recipe.what == what]
    return known[rng.integers(len(known))]


def captures(camera, faults, strength, seed):
    """Levels of a camera with these faults, and its maps."""
    maps, captured = draw_maps(camera, np.random.default_rng([seed, 0])), []
    for number, level in enumerate(CAMERAS[camera][1]):
        capture = Capture(camera, maps, level, np.random.default_rng([seed, 1, number]))
        for place, recipe in enumerate(faults):
            # the same pixels and frames at all levels
            on = _mask(recipe, strength, np.random.default_rng([seed, 2, place]))
            change, size = RATES.get(recipe.what), _size(recipe, strength, on)
            if recipe.what not in READINGS and recipe.what != "lost":
                (change or scaled(recipe.what))(capture, on, size)
        capture.expose()
        for place, recipe in enumerate(faults):
            on = _mask(recipe, strength, np.random.default_rng([seed, 2, place]))
            size, r = _size(recipe, strength, on), capture.readings
            if recipe.what == "lost":
                kept = ~on[:, 0, 0]
                capture.readings, capture.times = r[kept], capture.times[kept]
            elif recipe.what in READINGS:
                before = np.concatenate((r[:1], r[:-1]))
                new = READINGS[recipe.what](r, before, size, capture)
                capture.readings = np.where(on[: len(r)], new, r).astype(np.int64)
        captured.append(capture)
    return captured, maps


def compared(camera, faults, strength, seed):
    """Comparison with the device, which is known exactly or, of odd seeds, from a calibration."""
    captured, maps = captures(camera, faults, strength, seed)
    errors = {"dark_counts": np.zeros(captured[0].shape), "efficiency": 0.0}
    if seed % 2:
        maps, errors = calibrated(camera, maps, np.random.default_rng([seed, 3]))
    with TemporaryDirectory() as folder:
        device = device_of(camera, maps, folder)
        levels = [capture.level(device) for capture in captured]
        lights_hz = [level.light_hz * EFFICIENCY for level in levels]
        model = Model(device, [hz * maps["efficiency"][None] for hz in lights_hz])
        deviations = [
            level.exposure_s * np.hypot(errors["dark_counts"], hz * errors["efficiency"])
            for level, hz in zip(levels, lights_hz, strict=True)
        ]
        simulated = model.drawn(levels, seed + 10**6)
        return compare_levels(levels, simulated, model, errors=deviations)


def _options(name):
    """Alternatives of a name: "drift of light or gain" is right if one of them is."""
    kind, of, quantities = name.partition(" of ")
    return {kind + of + quantity for quantity in quantities.split(" or ")}


def verdict(faults, strength, seed):
    """What a comparison says of faults: right, vague, none, silent or wrong; and its names."""
    comparison = compared(faults[0].camera, faults, strength, seed)
    names, extras = map(set.union, *(judged(recipe, strength) for recipe in faults))
    named = said(comparison)
    options = [_options(name) for name in named - {"none"}]
    if any(not option & (names | extras) for option in options):
        return "wrong", named
    if any(option & names for option in options):
        return "right", named
    if "none" in named:
        return "none", named
    return ("vague" if comparison.alarms else "silent"), named
