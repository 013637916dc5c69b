import re

import pytest

from megalopta.config import load

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


@pytest.fixture(scope="session")
def check_words():
    """Refuses a figure without the dissertation's number, or with a caption of over 3 sentences."""

    def check(figure):
        number = re.fullmatch(r"(fig|table)-(\d+\.\d+)", figure.name)
        if number:
            kind = {"fig": "Figure", "table": "Table"}[number[1]]
            assert figure.title.startswith(f"{kind} {number[2]}: ")
        sentences = re.findall(r"(?<!Eq)[.?!](?= [A-Z(]|$)", figure.caption)
        assert 1 <= len(sentences) <= 3

    return check
