"""
Figure 4.2: 2-D sine grating of 4 cycles per frame
==================================================

S = 1 + C·sin(2πf·xr)·sin(2πf·yr) in coordinates turned by 45°, with C = 1 and nearest-neighbor
pooling to 60 × 60 px. The dissertation's rotation ("rot") has √2·f cycles per frame, not a whole
number, so that a circular shift moves a seam along; "periodic" has f cycles and no seam.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.assets_gen.grating import GratingVariant, moving_cycles, sine_grating
from megalopta.flow import resize

CYCLES, POOLED = 4.0, 60
variants: tuple[GratingVariant, ...] = ("rot", "periodic")
center = (np.arange(251) + 0.5) / 251
y, x = np.meshgrid(center, center, indexing="ij")
figure, panels = plt.subplots(1, 2, figsize=(9, 4.5), layout="constrained")
for axes, variant in zip(panels, variants, strict=True):
    grating = sine_grating(x, y, 1.0, CYCLES, variant=variant)
    axes.imshow(resize(grating, POOLED), cmap="gray", vmin=0, vmax=2)
    moving = moving_cycles(CYCLES, variant)
    print(f"cycles per frame, {variant}: dissertation {CYCLES:g}; here {moving:.3g} move, exact")
    axes.set(title=f"{variant}: {moving:.3g} cycles move")
    axes.set(xlabel="column (px)", ylabel="row (px)")
plt.show()
