"""Computes the table in `leaves.yaml` anew from the parameters that stand in it.

    pip install xleaf==1.2.2
    python -m megalopta.scenes.spectra.prospect

The model is PROSPECT-D (Féret et al., 2017, Remote Sens. Environ. 193:204), from 400 to 2500 nm. Of
its 2101 wavelengths those are kept between which straight lines are off by at most `TOLERANCE`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.reflectance import TABLE, Leaf

TOLERANCE = 0.004
"""Largest error of a table, in reflectance and in transmittance (1)."""
_LINE = 100


def computed(parameters: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Wavelengths (n,), nm, and reflectance and transmittance (2, n) of a leaf."""
    import xleaf  # type: ignore[import-not-found, unused-ignore]

    wavelengths = 1000 * np.asarray(xleaf.wavelengths, np.float64)
    return wavelengths, np.asarray(xleaf.simulate_leaf(**parameters, transmittance=True))


def tabulated(parameters: Mapping[str, float]) -> dict[str, list[float]]:
    """Wavelengths that are enough, and the reflectance and transmittance there."""
    wavelengths, curves = computed(parameters)
    curves = curves.round(3)
    kept = [0, len(wavelengths) - 1]
    while True:
        lines = np.stack([np.interp(wavelengths, wavelengths[kept], c[kept]) for c in curves])
        off = np.abs(lines - curves).max(axis=0)
        if off.max() <= TOLERANCE:
            break
        kept = sorted({*kept, int(off.argmax())})
    columns = zip(("wavelengths_nm", *Leaf._fields), (wavelengths.round(), *curves), strict=True)
    return {name: values[kept].tolist() for name, values in columns}


def _written(name: str, entry: Mapping[str, Any]) -> str:
    parameters = entry["prospect"]
    text = ", ".join(f"{key}: {value:g}" for key, value in parameters.items())
    lines = [f"{name}:", f"  prospect: {{{text}}}"]
    for key, values in tabulated(parameters).items():
        lines.append(f"  {key}:")
        line = "    ["
        for number in (f"{value:g}" for value in values):
            if len(line) + len(number) + 2 > _LINE:
                lines.append(line.rstrip())
                line = "     "
            line += f"{number}, "
        lines.append(line.removesuffix(", ") + "]")
    return "\n".join(lines)


def main() -> None:
    """Write the file anew."""
    text = TABLE.read_text("utf-8")
    head = "\n".join(line for line in text.splitlines() if line.startswith("#"))
    leaves = (_written(name, entry) for name, entry in strict_yaml.load(text).items())
    TABLE.write_text("\n\n".join([head, *leaves]) + "\n", "utf-8")


if __name__ == "__main__":
    main()
