"""Light to single-photon counts: every effect of a SPAD array, on plain arrays.

    sensor = preset("spadcam")
    exposure = expose(radiance, bands_nm, sensor, seed=0, stream="forest", expectation=True)
    exposure.counts, exposure.saturated, exposure.expectation.mean_reading

Light to volts, 0.9 to 1.7 µm: an array of photodiodes with CTIA pixels.

    sensor = CTIA_PRESETS["ctia_ingaas_quiet"]
    light = photocurrent(radiance, bands_nm, sensor)
    reading = expose_photocurrent(light, sensor, seed=0, stream="forest")
    reading.volts, reading.saturated

`expose` accepts both sensors, or the name of one, and returns counts or electrons.

Radiance is (T, H, W, B), W·m⁻²·sr⁻¹·nm⁻¹; bands_nm is (B, 2). No renderer is needed: any video in
these units works.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
