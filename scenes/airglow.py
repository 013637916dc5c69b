"""Airglow: the light of the night sky at 0.9 to 1.8 µm, in absolute units.

On a moonless night most of the short-wave infrared comes from hydroxyl some 87 km up (the Meinel
bands) and from molecular oxygen (1.27 µm). The table is the radiance of the zenith seen from the
ground, in means over 20 nm, put together from published figures:

- shape of the hydroxyl bands: the line list of Rousselot et al. (2000, A&A 354, 1134), its
  intensities taken as photon rates and summed over 20 nm;
- between the lines, 590 photons·s⁻¹·m⁻²·arcsec⁻²·µm⁻¹ at all wavelengths (Maihara et al. 1993, PASP
  105, 940, measured at 1.665 µm);
- height: the sky over Paranal has 14.4 mag·arcsec⁻² in H (Cuby et al. 2000), with the zero point of
  1.133e-9 W·m⁻²·µm⁻¹ (Cohen et al. 2003), as the mean over 1.51 to 1.79 µm;
- oxygen: what is then missing at 1.17 to 1.33 µm from 16.5 mag·arcsec⁻² in J (same sources,
  3.129e-9 W·m⁻²·µm⁻¹), all of it at 1.26 to 1.28 µm. It comes to 11 kilorayleigh.

A check that was not put in: the OH(4-2) band then has 78 kilorayleigh, and 80 is usual.

Real airglow changes by a factor of two within a night, grows toward the horizon by up to a factor
of six (van Rhijn) and has moving waves; here it is the same everywhere. Clouds are left out. Beyond
its ends, 0.89 and 1.79 µm, the table is constant and means nothing.
"""

from megalopta.scenes.scene import Lighting
from megalopta.scenes.spectrum import Spectrum

_FIRST_NM = 890.0
_STEP_NM = 20.0
# nW·cm⁻²·sr⁻¹·µm⁻¹, means over 20 nm
# fmt: off
_RADIANCE = (
    1.08, 0.61, 0.97, 1.01, 1.08, 1.50, 1.75, 2.69, 1.61, 1.65,
    3.50, 1.49, 1.93, 4.03, 1.74, 0.92, 3.64, 3.12, 1.15, 8.19,
    3.20, 3.19, 1.14, 0.48, 2.16, 3.31, 6.61, 7.50, 5.23, 7.96,
    7.15, 11.9, 12.3, 9.31, 5.25, 12.2, 12.8, 7.38, 6.96, 9.67,
    7.06, 8.71, 6.42, 3.34, 7.51, 8.89,
)
# fmt: on
_SI = 1e-8
"""From nW·cm⁻²·sr⁻¹·µm⁻¹ to W·m⁻²·sr⁻¹·nm⁻¹."""

AIRGLOW = Spectrum(
    tuple(_FIRST_NM + _STEP_NM * step for step in range(len(_RADIANCE))),
    tuple(_SI * value for value in _RADIANCE),
)
"""Radiance of the moonless zenith, W·m⁻²·sr⁻¹·nm⁻¹."""


def airglow_lighting(strength: float = 1.0) -> Lighting:
    """Return a sky that is lit by airglow alone, alike in all directions.

    Parameters
    ----------
    strength : float
        Multiple of the usual zenith radiance; 0.5 to 2 within a night.

    Raises
    ------
    ValueError
        When the strength is not positive and finite.
    """
    if not 0 < strength < float("inf"):
        raise ValueError(f"airglow strength {strength}: give a positive multiple of the usual sky")
    return Lighting(sky=AIRGLOW.scaled(strength))
