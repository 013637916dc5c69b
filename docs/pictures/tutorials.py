"""Run the notebook, and the page on flow methods; write what they print and draw next to them.

python docs/pictures/tutorials.py
"""

import json
import os
import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt

TUTORIALS = Path(__file__).parents[1] / "tutorials"

mpl.use("agg")
os.chdir(TUTORIALS)
names: dict[str, Any] = {}
for place, cell in enumerate(json.loads(Path("notebook.ipynb").read_text("utf-8"))["cells"]):
    if cell["cell_type"] == "code":
        with redirect_stdout(StringIO()) as printed:
            exec("".join(cell["source"]), names)
        if printed.getvalue():
            Path(f"notebook-{place}.txt").write_text(printed.getvalue(), "utf-8")
        for number in plt.get_fignums():
            plt.figure(number).savefig(f"notebook-{place}.png", dpi=100)
        plt.close("all")
page, names = Path("your-method.md").read_text("utf-8"), {}
for block in re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE):
    exec(block, names)  # writes limit.png
