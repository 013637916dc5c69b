"""
Noise remains where the dark current vanishes
=============================================

Dark InGaAs pixels over their reverse bias. At zero bias the mean current is zero, and the noise is
that of twice the saturation current. Points are simulated, lines are in closed form. Theory:
:doc:`/theory/ctia`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.constants import e, k

from megalopta.sensor import CTIA_PRESETS, changed, expose_photocurrent

EXPOSURE_S, SATURATION_A = 0.01, 100e-12
biases_v = np.linspace(0.002, 0.1, 12)
dark = np.zeros((40, 32, 32))
base = changed(
    CTIA_PRESETS["ctia_ingaas_quiet"],
    exposure_s=EXPOSURE_S,
    noise={"reset": False, "read_noise_v": 0.0},
    **dict.fromkeys(("offset_v", "offset_sigma_v", "gain_sigma_db", "dark_sigma"), 0.0),
)
to_electrons = base.capacitance_f / e
for number, what in enumerate(("mean (e⁻)", "variance (e⁻²)")):
    found = []
    for bias_v in biases_v:
        sensor = changed(base, bias={"kind": "fixed", "reverse_bias_v": bias_v})
        volts = expose_photocurrent(dark, sensor, seed=0, stream=f"{bias_v:g}").volts
        found.append((volts.mean(), volts.var() * to_electrons)[number] * to_electrons)
    rest = np.exp(-e * biases_v / (k * 300))
    law = SATURATION_A * EXPOSURE_S / e * (1 + (2 * number - 1) * rest)
    plt.plot(1e3 * biases_v, law, label=what)
    plt.plot(1e3 * biases_v, found, f"C{number}o")
plt.xlabel("reverse bias (mV)")
plt.ylabel("dark charge in 10 ms")
plt.legend()
plt.show()
