"""Sensors by name, as plain data.

`ideal` has the pixel, lens and exposure of `spadcam`, so that only the device differs: it counts
every photon on the pixel and nothing else.

`spadcam` follows the device sheet of dissertation §2.4 at 13.58 V anode voltage, which is 1.18 V
excess bias (13.40 V is about 1 V there). Measured there: pitch, active area, dark counts of one row
of 16 pixels, "peak efficiency below 1 % at 450 nm", quenching, breakdown spread, counter step and
leakage. Assumed, because not given:

- the spectral shape: absorption of silicon in 0.4 µm under a dead surface of 0.1 µm. Only the
  height at 450 nm is measured, as an upper limit. The motion bench of §2.4.8 (93 nW at 700 nm, 65
  counts in 0.1 s), if its beam covered 100 mm², allows 0.055 % at 700 nm where this curve has 0.11
  %; the light that reached the chip there is not known;
- dead time 1 µs: §2.4.1 says that recovery exceeds this;
- the lens: the dissertation illuminates the bare die;
- dependence on bias, which the dissertation shows as curves without numbers: counting starts at
  0.87 V excess, 3 σ of mismatch below 1 V, where all 16 pixels of a row were measured; dark counts
  grow e-fold in 0.12 V, so that breakdown mismatch causes most of the spread of ordinary pixels;
  efficiency saturates over 0.2 V. The best ratio of the two is then at 0.96 V, where the
  measurements begin. The height of the efficiency keeps it below 1 % at any bias;
- dark counts: five numbers of the row (mean 1.77, median 0.93, σ 1.77 Hz/µm², 11 of 16 pixels below
  1.5, σ 0.32 among these), matched including mismatch, fix the mixture;
- read noise 1 mV and 12 bits of the ADC; the swing follows from 320 counts of 10 mV.

On "nearly all pixels are fully saturated" at 13.68 V (§2.4.4), see `docs/theory/device.md`.

`array-12x4` has the crosstalk measured on such an array, by distance (orthogonal 1.03e-3, diagonal
1.62e-4, two away 1.3e-5), and its dark counts: median 159, 90 % below 1125 per second, a log-normal
distribution whose largest of 48 is then near 4700, as measured. The rest is assumed: 50 µm discs
250 µm apart, a custom-technology curve that peaks at 45 %, active quenching in 120 ns.

The devices of Table 2.1 have its efficiency and dark counts, at its bias. Only the peak of the
efficiency is given: these presets have it at all wavelengths, so use them near that wavelength.
Fill factor, dead time, mismatch and counter are not in the table; the presets have fill factor 1
(pitch² is the active area) and no other effect. A limit ("<5k", ">1k") is used as the value.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from megalopta.core import strict_yaml
from megalopta.core.bounded import read_text
from megalopta.core.validation import checked, merged
from megalopta.sensor.effects.crosstalk import with_kernel
from megalopta.sensor.optics import with_curve
from megalopta.sensor.spad.measured import with_hashes
from megalopta.sensor.spad.model import Sensor


class TableDevice(NamedTuple):
    """Column of Table 2.1, as printed."""

    reference: str
    """First author and number in the dissertation's bibliography"""
    node: str
    """CMOS process"""
    dark_counts_hz: float
    """Dark count rate at room temperature"""
    limit: str
    """`<` or `>` if the table gives a limit of the dark count rate"""
    excess_bias_v: float
    """Excess bias of both measurements"""
    active_area_um2: float
    density_hz_um2: float
    """Dark count rate per area, as printed in the table"""
    peak_efficiency: float
    """Largest detection probability, 0 to 1"""
    peak_nm: float
    """Wavelength of that peak"""


TABLE_2_1: dict[str, TableDevice] = {
    "niclass-800nm": TableDevice("Niclass [72]", "0.8 µm", 350, "", 5, 38, 9.2, 0.12, 635),
    "niclass-350nm": TableDevice("Niclass [71]", "0.35 µm", 750, "", 3.3, 78, 9.6, 0.36, 465),
    "mandai-180nm": TableDevice("Mandai [73]", "180 nm", 5e3, "<", 4, 78, 64, 0.36, 600),
    "gersbach-130nm-5v": TableDevice("Gersbach [74]", "130 nm", 11e3, "", 5, 58, 190, 0.36, 480),
    "gersbach-130nm-2v": TableDevice("Gersbach [74]", "130 nm", 220, "", 2, 58, 3.8, 0.26, 480),
    "richardson-130nm": TableDevice("Richardson [75]", "130 nm", 25, "", 1.4, 50, 0.5, 0.28, 500),
    "webster-130nm": TableDevice("Webster [70]", "130 nm", 1e3, ">", 12, 50, 20, 0.72, 560),
}
"""Columns of Table 2.1 by preset name."""


_FIELDS = strict_yaml.load(Path(__file__).with_suffix(".yaml").read_text("utf-8"))
_FIELDS |= {
    name: _FIELDS["ideal"]
    | {
        "source": f"Berkovich, dissertation (2017), Table 2.1: {device.reference}, {device.node}",
        "pitch_m": device.active_area_um2**0.5 * 1e-6,
        "efficiency": {"wavelengths_nm": (200, 1100), "values": (device.peak_efficiency,) * 2},
        "bias": {"excess_v": device.excess_bias_v, "reference_v": device.excess_bias_v},
        "dark_counts": {"bulk_mean_hz_um2": device.dark_counts_hz / device.active_area_um2},
    }
    for name, device in TABLE_2_1.items()
}
PRESETS: dict[str, Sensor] = {
    name: checked(Sensor, {"name": name, **fields}) for name, fields in _FIELDS.items()
}


def preset(name: str) -> Sensor:
    """Return a sensor by name.

    Raises ValueError if there is no preset of this name.
    """
    if not isinstance(name, str) or name not in PRESETS:
        raise ValueError(f"sensor {name!r}: no such preset; choose from {', '.join(PRESETS)}")
    return PRESETS[name]


def load_sensor(path: str | Path) -> Sensor:
    """Read a sensor, such as a measured device, from a YAML file.

    The file has the fields of `Sensor`; `preset` supplies missing ones. Paths in it are relative to
    the file.

    Raises ValueError if the file or a map is missing, or a field is unknown or invalid.
    """
    path = Path(path)
    try:
        values = strict_yaml.load(read_text(path))
    except OSError as error:
        raise ValueError(
            f"{path}: {error.strerror}; give the path of a device's YAML file"
        ) from error
    except (ValueError, RecursionError) as error:
        problem = " ".join(str(error).split())
        raise ValueError(f"{path}: cannot be read as YAML: {problem}") from error
    if not isinstance(values, dict):
        raise ValueError(f"{path}: a sensor is a mapping of fields to values")
    try:
        fields = with_files(values, path.parent)
        base = preset(fields.pop("preset")).model_dump() if "preset" in fields else {}
        return checked(Sensor, merged(base, fields))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def with_files(values: Mapping[str, Any], folder: Path | None) -> dict[str, Any]:
    """Make a sensor's fields independent of the folder to which their paths are relative.

    It is that of the file with these fields; None: they are the user's (`named_path`).

    Maps get absolute paths and hashes; curves and a kernel of crosstalk in files become
    numbers.
    """
    resolved = dict(values)
    for name, values_of_part in values.items():
        if name == "measured":
            resolved[name] = with_hashes(values_of_part, folder)
        elif name == "efficiency":
            resolved[name] = with_curve(values_of_part, folder, name)
        elif name == "crosstalk":
            resolved[name] = with_kernel(values_of_part, folder)
        elif name in ("lens", "filters") and isinstance(values_of_part, Mapping):
            resolved[name] = {
                key: with_curve(value, folder, f"{name}.{key}")
                for key, value in values_of_part.items()
            }
    return resolved
