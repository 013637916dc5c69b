"""Reference: a page for each topic of a package, of what its `__init__.pyi` publishes."""

import ast
import importlib
import inspect
import re
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel
from sphinx.pycode import ModuleAnalyzer

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDER = "generated/reference"
TOPICS: dict[str, dict[str, tuple[str, ...]]] = {
    "megalopta": {
        "Datasets and photons": ("dataset.", "core.errors"),
        "Choosing a camera": ("benchmark.",),
        "Recordings and films": ("camera.", "report."),
    },
    "megalopta.scenes": {
        "Scenes": ("base", "build", "scene", "forest.", "meshes.", "moving_objects", "stimuli."),
        "Light and pictures": ("light", "levels", "tone_mapping"),
        "Cameras and motion": ("cameras.", "trajectories.", "shutter", "imu"),
    },
    "megalopta.render": {
        "Radiance": ("scene_renderer", "settings", "noise", "variant", "mitsuba_loader"),
        "Ground truth": ("truth.",),
        "Files": ("exr", "environment", "footage."),
    },
    "megalopta.sensor": {
        "Counts from light": ("exposure", "quantities", "sampling.", "change", "histograms"),
        "Expected counts": ("expectations", "information"),
        "Sensors": ("image_sensors", "optics", "spad.", "frame.", "contrast."),
        "Effects of avalanches": ("effects.",),
        "CTIA arrays": ("ctia.",),
        "Calibration": ("calibrate.",),
        "Comparison": ("compare.",),
        "Files": ("formats.",),
    },
    "megalopta.flow": {
        "Flow between frames": ("one_call", "detectors.registry", "formats", "color_wheel"),
        "Methods": ("detectors.",),
        "Motion of the camera": ("camera_motion",),
        "Benchmarks": ("benchmark", "benchmark_search", "stimuli."),
        "Errors and bounds": ("metrics.",),
    },
    "megalopta.assets_gen": {"Meshes and textures": ("",)},
}
"""Titles of pages, and the beginnings of the modules whose names they show; the first one counts"""
SHORT = {"Floats": "NDArray[float64]", "Ints": "NDArray[int64]", "Mask": "NDArray[bool]"}
"""Types of arrays, as readers know them"""


def setup(app: "Sphinx") -> dict[str, bool]:
    """Write the pages before pages are read."""
    app.connect("builder-inited", lambda app: write_pages(Path(app.srcdir) / FOLDER))
    app.connect("autodoc-process-signature", _as_in_the_source)
    app.connect("autodoc-process-docstring", _as_written, priority=300)  # before numpydoc
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write_pages(folder: Path) -> None:
    """Write the pages of every package, and their list; pages that are the same stay untouched."""
    folder.mkdir(parents=True, exist_ok=True)
    index = ["API reference", "=============", ""]
    index += ["Import a name from the package that publishes it.", ""]
    index += [".. toctree::", "   :maxdepth: 2", ""]
    pages = {"index": index}
    for package, topics in TOPICS.items():
        index.append(f"   {package}")
        lines = [package, "=" * len(package), "", f".. automodule:: {package}"]
        lines += ["   :no-members:", "", ".. toctree::", "   :hidden:", ""]
        names: dict[str, list[str]] = {title: [] for title in topics}
        for name, module in published(package).items():
            names[topic_of(package, module)].append(name)
            # of variants for type checkers, the one that runs is shown
            variants = ModuleAnalyzer.for_module(f"{package}.{module}")
            variants.analyze()
            variants.overloads.clear()
        for title in topics:
            lines.append(f"   {package}.{slug(title)}")
        for title in topics:
            lines += ["", f":doc:`{title} <{package}.{slug(title)}>`", "-" * 80, ""]
            lines += [".. list-table::", "   :widths: 30 70", ""]
            page = pages[f"{package}.{slug(title)}"] = [title, "=" * len(title), ""]
            page += [f".. currentmodule:: {package}", ""]
            for name in sorted(names[title], key=lambda name: (not name.islower(), name.lower())):
                thing = getattr(importlib.import_module(package), name)
                is_described = inspect.isclass(thing) or inspect.isroutine(thing)
                link = f":py:obj:`{name} <{package}.{name}>`" if is_described else f"``{name}``"
                lines += [f"   * - {link}", f"     - {first_line(thing) if is_described else ''}"]
                page += entry(package, name, thing) if is_described else []
        pages[package] = lines
    for name, lines in pages.items():
        path, text = folder / f"{name}.rst", "\n".join([*lines, ""])
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def published(package: str) -> dict[str, str]:
    """Names that a package publishes, and the modules below it that they come from."""
    stub = Path(importlib.import_module(package).__file__ or "").with_suffix(".pyi")
    return {
        alias.name: node.module or ""
        for node in ast.parse(stub.read_text("utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def topic_of(package: str, module: str) -> str:
    """Title of the page of a module. Raises LookupError if none is its page."""
    for title, beginnings in TOPICS[package].items():
        for beginning in beginnings:
            if module == beginning or (
                beginning[-1:] in (".", "") and module.startswith(beginning)
            ):
                return title
    raise LookupError(f"{package}.{module}: on no page; add it to TOPICS of {Path(__file__).name}")


def slug(title: str) -> str:
    """Name of a page's file."""
    return title.lower().replace(" ", "-")


def first_line(thing: Any) -> str:
    """First line of a docstring, in one cell of a table."""
    return (inspect.getdoc(thing) or "").partition("\n")[0].replace("|", r"\|")


def entry(package: str, name: str, thing: Any) -> list[str]:
    """Directive of one class or function; fields of a model are in its table."""
    if not inspect.isclass(thing):
        return [f".. autofunction:: {package}.{name}", ""]
    lines = [f".. autoclass:: {package}.{name}"]
    if issubclass(thing, BaseModel) and thing.model_fields:
        lines.append(f"   :exclude-members: {', '.join(thing.model_fields)}")
    return [*lines, ""]


def _as_in_the_source(app, what, name, thing, *rest):
    """Show types as the source names them, which is shorter than what they stand for."""
    _options, signature, returns = rest
    if inspect.ismodule(thing):
        return signature, returns
    if inspect.isclass(thing):
        if issubclass(thing, BaseModel) or not signature:
            return "(...)" if signature else signature, returns
        parameters = inspect.signature(thing).parameters.values()
        plain = ", ".join(str(one.replace(annotation=one.empty)) for one in parameters)
        return f"({re.sub('<[^<>]*>', '...', plain)})", None
    try:
        (node,) = ast.parse(textwrap.dedent(inspect.getsource(inspect.unwrap(thing)))).body
    except (TypeError, OSError, SyntaxError):
        return signature, returns
    if not isinstance(node, ast.FunctionDef):
        return signature, returns
    if node.args.args and node.args.args[0].arg in ("self", "cls"):
        del node.args.args[0]
    shown = [ast.unparse(part) if part else None for part in (node.args, node.returns)]
    for name, known in SHORT.items():
        shown = [part and re.sub(rf"\b{name}\b", known, part) for part in shown]
    return f"({shown[0]})", shown[1]


def _as_written(app, what, name, thing, options, lines):
    """Keep the lines of indented equations, and bars as bars."""
    kept: list[str] = []
    for line in lines:
        depth = len(line) - len(line.lstrip())
        above = next((text for text in reversed(kept) if text.strip()), "")
        margin = above[: len(above) - len(above.lstrip())]
        is_start = line.strip() and kept and not kept[-1].strip()
        if is_start and depth >= 4 + len(margin) and not above.rstrip().endswith("::"):
            kept += [f"{margin}::", ""]
        kept.append(line)
    parts = "\n".join(kept).split("`")
    parts[::2] = [re.sub(r"(?<!\\)\|", r"\\|", part) for part in parts[::2]]
    lines[:] = "`".join(parts).split("\n")
