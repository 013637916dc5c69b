"""
Night is brightest where silicon is blind
=========================================

Photons on an open plane by a full moon and on a moonless night, and the share that three detectors
see. Visible light falls 250-fold between the two. The airglow beyond 1 µm stays, and only InGaAs
sees it. Theory: :doc:`/theory/outdoor-light`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.constants import c, h

from megalopta.scenes import LEVELS
from megalopta.sensor import IMAGE_SENSORS

nm = np.arange(400, 1701)
photon_j = h * c / (1e-9 * nm)
plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, (light, share) = plt.subplots(2, 1, sharex=True, height_ratios=(3, 2))
levels = {"full moon": ("full_moon", "C1", "--"), "no moon": ("starlight", "C0", "-")}
for label, (level, color, dash) in levels.items():
    photons = LEVELS[level].spectrum()(nm) / photon_j
    light.semilogy(nm, photons, dash, color=color)
    light.text(620, 0.4 * photons[220], label, color=color, va="top", weight="bold")
sensors = {"EMCCD": ("ixon-888", 740), "SPAD": ("canon-3mp", 440), "InGaAs": ("ctia_ingaas", 1250)}
for (label, (name, at_nm)), line in zip(sensors.items(), ("C2--", "C4-.", "C3-")):
    curve = IMAGE_SENSORS[name].efficiency
    share.plot(curve.wavelengths_nm, 100 * np.array(curve.values), line)
    share.text(
        at_nm,
        60 if label == "InGaAs" else 84 * (label == "EMCCD") or 30,
        label,
        color=line[:2],
        weight="bold",
    )
light.set(ylabel="photons\n(m⁻²·s⁻¹·nm⁻¹)", ylim=(1e9, 1e14))
share.set(xlabel="wavelength (nm)", ylabel="seen (%)", xlim=(400, 1700), ylim=(0, 100))
figure.suptitle("A moonless night is brightest where silicon is blind")
plt.show()
