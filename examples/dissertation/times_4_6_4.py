"""
Section 4.6.4: computing time per frame
=======================================

Processor time on this machine for a frame with known predecessors, least to most of five runs, from
counts of 10 photons per pixel to responses. The dissertation used MATLAB on an Intel Core i5-5300U
at 2.3 GHz.
"""

import time

from megalopta.benchmark.trial import GratingTemplate
from megalopta.flow import METHODS, MovingTemplate, draw_counts

STATED_MS = {
    **{"BM": ("17", "338"), "IIA": ("6", "9"), "EMD": ("< 0.3", "< 3")},
    **{"NDM": ("< 0.3", "< 3"), "NDS": ("< 0.3", "< 3")},
}
grating = GratingTemplate().pixels()
for place, size in enumerate((60, 240)):
    light = MovingTemplate(grating, 5, size).light(0, 16)
    counts = draw_counts(light * 10 * size**2, 0, "times")
    for name, stated in STATED_MS.items():
        respond = METHODS[name].start((size, size))
        respond(counts, 1.0)  # fills its memory, and compiles
        spent_s = []
        for _ in range(5):
            start = time.process_time()
            respond(counts, 1.0)
            spent_s.append(time.process_time() - start)
        least_ms, most_ms = (1e3 * limit(spent_s) / len(counts) for limit in (min, max))
        measured = f"{least_ms:.2g} to {most_ms:.2g} ms"
        print(f"{size} × {size} px, {name}: dissertation {stated[place]} ms; here {measured}")
