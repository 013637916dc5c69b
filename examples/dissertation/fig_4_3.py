"""
Figure 4.3: rendered forests in place of photographs
====================================================

Four seeded forests in four lights replace the photographs of the dissertation, with their fields of
view, in cylindrical projection, where a camera rotation shifts columns. They are shown as sRGB;
templates are linear in light. Contrast is the standard deviation over the mean.
"""

import matplotlib.pyplot as plt

from megalopta.benchmark.panoramas import NATURAL_PANORAMAS, ROWS, natural_template
from megalopta.scenes import ToneCurve
from megalopta.scenes.spectra.color import encode_srgb

figure, panels = plt.subplots(4, 1, figsize=(9, 9), layout="constrained")
for letter, axes, (name, stated_deg) in zip("abcd", panels, NATURAL_PANORAMAS.items(), strict=True):
    light = natural_template(name)
    seen_deg, contrast = 360 * ROWS / light.shape[1], (light / light.mean()).std()
    print(f"251 columns of ({letter}): dissertation {stated_deg:g}°; here {seen_deg:.1f}°", end="")
    print(f", contrast {contrast:.2f} in light")
    axes.imshow(encode_srgb(ToneCurve.of([light])(light)), "gray")
    axes.set_title(f"({letter}) {name}, 251 columns cover {stated_deg:g}°", loc="left")
    axes.set_axis_off()
plt.show()
