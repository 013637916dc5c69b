"""Render the panoramas that the program ships again, all or some by name.

A few minutes each; needed after a change of what a forest looks like (`RENDER_MODEL`).
"""

import sys

from megalopta.benchmark.panoramas import (
    NATURAL_PANORAMAS,
    SHIPPED,
    render_panorama,
    write_template,
)

for name in sys.argv[1:] or NATURAL_PANORAMAS:
    recipe = NATURAL_PANORAMAS[name]
    radiance, noise = render_panorama(recipe, lambda: print(".", end="", flush=True))
    write_template(SHIPPED / f"{name}.exr", recipe, radiance, noise)
    print(f" {name}: noise of a pixel {noise.rms_over_mean:.2%} of the mean radiance")
