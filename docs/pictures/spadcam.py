"""Draw README's picture of calibration and comparison, from an emulated SPADCAM.

    python docs/pictures/spadcam.py

records, calibrates and compares as `docs/tutorials/spadcam.md` does, in `out/pictures/spadcam`, and
writes the first three charts of both pages to `docs/spadcam.png`. Chromium draws them.
"""

import re
import shutil
import subprocess
from pathlib import Path

DOCS = Path(__file__).parent.parent
OUT, PICTURE = Path("out/pictures/spadcam"), DOCS / "spadcam.png"
PAGES, CHARTS = ("device.html", "comparison.html"), 3
WIDTH_PX, HEIGHT_PX = 1256, 656
BROWSERS = "chromium", "chromium-browser", "google-chrome"
STYLE = """
body { margin: 8px; display: grid; grid-template-columns: repeat(3, 1fr); gap: 8px }
svg { width: 100%; height: auto }
"""


def record() -> None:
    """Run the shell blocks of the tutorial: six recordings, calibration, comparison."""
    tutorial = (DOCS / "tutorials/spadcam.md").read_text("utf-8")
    commands = "\n".join(re.findall(r"```sh\n(.*?)```", tutorial, re.DOTALL))
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    subprocess.run(["bash", "-e"], input=commands, text=True, cwd=OUT, check=True)


def draw() -> None:
    """Lay out the charts, and write the picture."""
    charts = []
    for page in PAGES:
        shown = re.findall(r"<svg.*?</svg>", (OUT / page).read_text("utf-8"), re.DOTALL)
        charts += shown[:CHARTS]
    sheet = OUT / "sheet.html"
    sheet.write_text(f"<meta charset=utf-8><style>{STYLE}</style>{''.join(charts)}", "utf-8")
    browser = next(each for each in BROWSERS if shutil.which(each))
    asked = f"--headless --no-sandbox --hide-scrollbars --window-size={WIDTH_PX},{HEIGHT_PX}"
    to = [f"--screenshot={PICTURE.resolve()}", sheet.resolve().as_uri()]
    subprocess.run([browser, *asked.split(), *to], check=True, capture_output=True)


if __name__ == "__main__":
    record()
    draw()
