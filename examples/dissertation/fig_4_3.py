"""
Figure 4.3: rendered forests in place of photographs
====================================================

Four seeded forests in four lights replace the photographs of the dissertation, with their fields of
view, in cylindrical projection, where a camera rotation shifts columns. They are shown as sRGB;
templates are linear in light. Dead leaves have the scale-free spectrum of natural pictures.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.assets_gen import generator
from megalopta.assets_gen.surface_textures import dead_leaves
from megalopta.benchmark.panoramas import NATURAL_PANORAMAS, ROWS, natural_template
from megalopta.flow.stimuli.statistics import fitted_slope, power_spectrum
from megalopta.scenes import ToneCurve
from megalopta.scenes.spectra.color import encode_srgb

forests = {name: natural_template(name) for name in NATURAL_PANORAMAS}
figure = plt.figure(figsize=(9, 14), layout="constrained")
*pictures, (spectra, gradients) = [
    *([figure.add_subplot(6, 1, row + 1)] for row in range(4)),
    (figure.add_subplot(3, 2, 5), figure.add_subplot(3, 2, 6)),
]
for letter, (axes,), (name, light) in zip("abcd", pictures, forests.items(), strict=True):
    axes.imshow(encode_srgb(ToneCurve.of([light])(light)), "gray")
    degrees = NATURAL_PANORAMAS[name]
    axes.set_title(f"({letter}) {name}, 251 columns cover {degrees:g}°", loc="left")
    axes.set_axis_off()
leaves = dead_leaves((ROWS, 753), generator(1, "figure 4.3"))
edges = np.linspace(-4, 4, 81)
for name, light in {**forests, "dead leaves": leaves}.items():
    spectra.loglog(*power_spectrum(light), label=name)
    gradient = np.diff(light, axis=1, append=light[:, :1])
    share, _ = np.histogram(gradient / gradient.std(), edges)
    gradients.semilogy((edges[:-1] + edges[1:]) / 2, share / gradient.size)
    numbers = {
        "contrast": (light / light.mean()).std(),
        "spectrum slope": fitted_slope(*power_spectrum(light)),
        "gradient kurtosis": np.mean(gradient**4) / np.mean(gradient**2) ** 2,
        "gradient contrast": np.sqrt(np.mean(gradient**2)) / light.mean(),
        "flat share": np.mean(np.abs(gradient) < 0.01 * light.mean()),
    }
    print(f"{name:12s}", ", ".join(f"{field} {value:.2g}" for field, value in numbers.items()))
spectra.set(xlabel="frequency (cycles/px)", ylabel="power (mean² px²)")
spectra.legend()
gradients.set(xlabel="gradient along rows (σ)", ylabel="share of pixels")
plt.show()
