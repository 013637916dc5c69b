"""Exposure and light as names of files and folders, and headers of files, state them.

    dark_10ms   flat-2e7-100us   exp=1e-5_light=2e7   exposure_us: 10   {"exposure_s": 1e-05}

A time needs its unit, unless it has a name; light is a number with an exponent, or has a name.
"""

import re
from collections.abc import Mapping
from typing import TypeAlias

_IN_SECOND = {"ns": 1e9, "us": 1e6, "µs": 1e6, "μs": 1e6, "ms": 1e3, "s": 1.0, "": 1.0}
_NUMBER, _UNIT, _IS = r"(\d*\.?\d+(?:e[-+]?\d+)?)", "(ns|[uµμ]s|ms|s)", r"[\"']?\s*[=:]\s*[\"']?"
_END = r"(?![a-z0-9])"
_NAMED_TIME = re.compile(
    rf"(?:exp(?:osure)?|integration)(?:[ _]?time)?(?:_{_UNIT})?{_IS}{_NUMBER}\s?{_UNIT}?{_END}"
)
_NAMED_LIGHT = re.compile(rf"light{_IS}{_NUMBER}{_END}")
_TIME = re.compile(rf"(?:^|[^a-z0-9.=:]|exp|exposure|\bt){_NUMBER}[ _]?{_UNIT}{_END}")
_LIGHT = re.compile(rf"(?:^|[^a-z0-9.=:])(\d+(?:\.\d+)?e\+?\d+){_END}")
_DARK = re.compile(r"(?<![a-z])(?:dark|dcr)(?:s|frames?|counts?)?(?![a-z])")
Conditions: TypeAlias = Mapping[str, float]
"""What is stated of `exposure_s`, and `light`: photons per second and pixel, or watts of the beam;
0: dark"""


def conditions_in(text: str, is_name: bool = False) -> Conditions:
    """Return what a header, or the name of a file or folder, states once of each."""
    text = text.lower()
    times = [(number, unit or of_name) for of_name, number, unit in _NAMED_TIME.findall(text)]
    lights = _NAMED_LIGHT.findall(text)
    if is_name:
        times = times or _TIME.findall(text)
        lights = lights or _LIGHT.findall(text) or ["0"] * bool(_DARK.search(text))
    exposures_s = {float(number) / _IN_SECOND[unit] for number, unit in times} - {0.0}
    stated = {"exposure_s": exposures_s, "light": set(map(float, lights))}
    return {quantity: values.pop() for quantity, values in stated.items() if len(values) == 1}
