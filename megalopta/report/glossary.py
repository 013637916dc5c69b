"""Words of the report, each in a sentence."""

from collections.abc import Collection

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

_OF_COUNTERS = {"Events", "Reading", "Shot noise", "Dark counts", "Dead time", "Corrected"}


def glossary(units: Collection[str]) -> dict[str, str]:
    """Return what each word means, of those that sensors with these units ask for."""
    left_out = set() if "counts" in units else _OF_COUNTERS
    return {word: meaning for word, meaning in _GLOSSARY.items() if word not in left_out}
