"""Draw README's picture of calibration and comparison, from an emulated SPADCAM.

    python docs/pictures/spadcam.py

records, calibrates and compares as `docs/tutorials/spadcam.md` does, in `out/pictures/spadcam`, or
takes what is there, and writes charts of both pages to `docs/spadcam.png`. Chromium draws them.
"""

import re
import shutil
import subprocess
from pathlib import Path

DOCS = Path(__file__).parent.parent
OUT, PICTURE = Path("out/pictures/spadcam"), DOCS / "spadcam.png"
CHARTS = {
    "An emulated camera, calibrated: dead time": ("device.html", "Saturation curve"),
    "The emulated camera against its model": ("comparison.html", "Differences"),
}
"""By title: page, and start of the chart's label"""
WIDTH_PX, HEIGHT_PX = 600, 890
BROWSERS = "chromium", "chromium-browser", "google-chrome"
STYLE = """
body { margin: 8px; font: 24px sans-serif }
figure { margin: 0 0 16px }
svg { width: 100%; height: auto; --rule: #e3e3e3 }
"""


def record() -> None:
    """Run the shell blocks of the tutorial: six recordings, calibration, comparison."""
    tutorial = (DOCS / "tutorials/spadcam.md").read_text("utf-8")
    commands = "\n".join(re.findall(r"```sh\n(.*?)```", tutorial, re.DOTALL))
    OUT.mkdir(parents=True)
    subprocess.run(["bash", "-e"], input=commands, text=True, cwd=OUT, check=True)


def draw() -> None:
    """Lay out the charts, and write the picture."""
    sheet, figures = OUT / "sheet.html", ""
    for title, (page, label) in CHARTS.items():
        chart = rf'<svg[^>]*aria-label="{label}.*?</svg>'
        svg, *_ = re.findall(chart, (OUT / page).read_text("utf-8"), re.DOTALL)
        figures += f"<figure><figcaption>{title}</figcaption>{svg}</figure>"
    sheet.write_text(f"<meta charset=utf-8><style>{STYLE}</style>{figures}", "utf-8")
    browser = next(each for each in BROWSERS if shutil.which(each))
    asked = f"--headless --no-sandbox --hide-scrollbars --window-size={WIDTH_PX},{HEIGHT_PX}"
    to = [f"--screenshot={PICTURE.resolve()}", sheet.resolve().as_uri()]
    subprocess.run([browser, *asked.split(), *to], check=True, capture_output=True)


if __name__ == "__main__":
    if not OUT.exists():
        record()
    draw()
