import pytest

from megalopta.configuration import load

TINY = {
    "camera.width": "48",
    "camera.height": "40",
    "trajectory.frames": "24",
    "render.samples_per_pixel": "1",
    "render.bands_nm": "[[450, 550], [550, 650]]",
    "benchmark.sizes": "[40]",
    "benchmark.flux_min": "1e4",
    "benchmark.flux_max": "1e8",
    "benchmark.fluxes_per_decade": "1",
    "benchmark.repeats": "2",
}


@pytest.fixture(scope="session")
def tiny():
    """A grating sequence that takes a second to render."""
    return load("grating", TINY)
