"""What axe, the accessibility checker, finds on a page as Chromium shows it, and what is cut off.

Needs Chromium and axe's script, which `pip install --no-deps axe-playwright-python` brings.
"""

import html
import importlib.util
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

_PACKAGE = importlib.util.find_spec("axe_playwright_python")
needs_chromium = pytest.mark.skipif(
    shutil.which("chromium") is None, reason="chromium is not installed"
)
needs_axe = pytest.mark.skipif(
    _PACKAGE is None or shutil.which("chromium") is None, reason="axe or chromium is not installed"
)
_RUN = """<script>%s</script><script>
addEventListener("load", () => axe.run().then(found => {
  const told = document.createElement("pre");
  told.id = "axe";
  told.textContent = JSON.stringify(
    found.violations.map(each => [each.id, each.nodes.map(node => node.html.slice(0, 200))]));
  document.body.append(told);
}));
</script></body>"""


def violations(page: Path, folder: Path, theme: str) -> list[list[object]]:
    """Rules that a page breaks in a theme, "light" or "dark", and where."""
    script = Path(_PACKAGE.submodule_search_locations[0], "axe.min.js").read_text("utf-8")
    text = page.read_text("utf-8").replace("light dark", theme)
    text = text.replace("(prefers-color-scheme: dark)", "all" if theme == "dark" else "not all")
    copy = folder / f"{page.stem}-{theme}.html"
    copy.write_text(text.replace("</body>", _RUN % script), "utf-8")
    return _told(copy, folder)


_MEASURE = """<script>addEventListener("load", () => {
  for (const details of document.querySelectorAll("details")) details.open = true;
  const cut = [...document.body.querySelectorAll("*")].filter(element =>
    !element.parentElement.closest(".scroll, pre, svg")
    && element.getBoundingClientRect().right > innerWidth + 1);
  parent.postMessage(cut.map(element => element.outerHTML.slice(0, 200)), "*");
});</script></body>"""
_FRAME = """<body><iframe src="%s" style="width: %dpx; height: 900px"></iframe><script>
addEventListener("message", event => {
  const told = document.createElement("pre");
  told.id = "axe";
  told.textContent = JSON.stringify(event.data);
  document.body.append(told);
});
</script></body>"""


def cut_off(page: Path, folder: Path, width_px: int) -> list[str]:
    """Elements of a page, its details open, that reach beyond a window of this width.

    What lies in a box that scrolls does not count.
    """
    copy, frame = folder / f"{page.stem}-{width_px}.html", folder / f"frame-{page.stem}.html"
    copy.write_text(page.read_text("utf-8").replace("</body>", _MEASURE), "utf-8")
    frame.write_text(_FRAME % (copy.as_uri(), width_px), "utf-8")
    return _told(frame, folder)


def _told(page: Path, folder: Path) -> list[Any]:
    """What a script on a page writes there as JSON."""
    shown = subprocess.run(
        [
            *("chromium", "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"),
            *("--virtual-time-budget=60000", f"--user-data-dir={folder / 'profile'}"),
            page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stdout
    told = re.search(r'<pre id="axe">(.*?)</pre>', shown, re.DOTALL)
    return json.loads(html.unescape(told[1]))
