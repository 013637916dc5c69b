"""Draw the moving picture of README: a flight through a rain forest, from noon to starlight.

    python docs/pictures/flight.py

renders `flight.yaml` to `out/pictures/flight`, or takes what is finished there, and writes
`docs/flight.gif`. A few frames of each light level follow each other; the light is rendered once.
"""

import subprocess
import sys
from pathlib import Path

from megalopta.report.images import Row, composed, gif
from megalopta.report.panels import View, sequence_view
from megalopta.report.readings import Treatment

HERE = Path(__file__).parent
OUT, PICTURE = Path("out/pictures/flight"), HERE.parent / "flight.gif"
WIDTH_PX, LETTERS_PX, FRAME_MS = 1040, 15, 200


def moment(seen: View, index: int) -> tuple[str, Row]:
    """Return label and pictures of a frame, at a light level that falls from frame to frame."""
    brightest_first = seen.of("readings")[::-1]
    readings = brightest_first[index * len(brightest_first) // len(seen.frames)]
    (light,), (motion,) = seen.of("light"), seen.of("motion")
    (flow,) = (each for each in seen.of("flow") if each.level == readings.level)
    panels = [
        ("light, as a well-lit eye would see it", light),
        (f"photons: {readings.caption}", readings),
        ("motion found in the photons (PF)", flow),
        ("true motion", motion),
    ]
    frame = seen.frames[index]
    return readings.level, [(label, panel.picture(frame)) for label, panel in panels]


def draw() -> None:
    """Render, expose, find flow, and write the picture."""
    rendering = ["render", str(HERE / "flight.yaml"), "--out", str(OUT)]
    for asked in (rendering, ["sense", str(OUT)], ["flow", str(OUT)]):
        subprocess.run([sys.executable, "-m", "megalopta", *asked], check=True)
    seen = sequence_view(OUT, Treatment())
    moments = [moment(seen, index) for index in range(len(seen.frames))]
    images = [composed(*each, WIDTH_PX, LETTERS_PX).quantize(128) for each in moments]
    PICTURE.write_bytes(gif(images, FRAME_MS))
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1e6:.1f} MB, {len(images)} frames")


if __name__ == "__main__":
    draw()
