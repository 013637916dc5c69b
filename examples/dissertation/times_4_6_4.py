"""
Section 4.6.4: computing time per frame
=======================================

Processor time on this machine for a frame with known predecessors, median of three runs, from
counts of 10 photons per pixel to responses. The dissertation used MATLAB on an Intel Core i5-5300U
at 2.3 GHz.
"""

import statistics
import time

from megalopta.benchmark.trial import GratingTemplate
from megalopta.flow import METHODS, MovingTemplate, draw_counts

PRINTED_MS = {
    **{"BM": ("17", "338"), "IIA": ("6", "9"), "EMD": ("< 0.3", "< 3")},
    **{"NDM": ("< 0.3", "< 3"), "NDS": ("< 0.3", "< 3")},
}
grating = GratingTemplate().pixels()
for place, size in enumerate((60, 240)):
    light = MovingTemplate(grating, 5, size).light(0, 16)
    counts = draw_counts(light * 10 * size**2, 0, "times")
    for name, printed in PRINTED_MS.items():
        respond = METHODS[name].start((size, size))
        respond(counts, 1.0)  # fills its memory, and compiles
        spent_s = []
        for _ in range(3):
            start = time.process_time()
            respond(counts, 1.0)
            spent_s.append(time.process_time() - start)
        time_ms = 1e3 * statistics.median(spent_s) / len(counts)
        print(f"{size} × {size} px, {name}: {time_ms:.2g} ms; printed: {printed[place]} ms")
