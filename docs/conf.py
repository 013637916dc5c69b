"""How `make docs` builds the site: of what lies in this folder, and of the code."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

from megalopta import __version__ as release

project = "megalopta"
html_title = f"megalopta {release.partition('+')[0]}"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "pydantic_fields",
    "packages",
    "website",
]
default_role = "py:obj"
exclude_patterns = [
    "gallery",
    "style.md",
    "example_device",
    "public_arrays",
    "extensions",
    "generated/gallery/**.ipynb",
    "generated/dissertation/*.ipynb",
]
templates_path = []

myst_enable_extensions = ["colon_fence", "dollarmath", "deflist"]
myst_heading_anchors = 4

# Pages are looked at from a disk, without a network: no fonts, scripts or styles from elsewhere.
html_theme = "furo"
html_static_path = ["style"]
html_css_files = ["site.css"]
html_js_files = [("site.js", {"defer": "defer"})]
html_search_scorer = str(Path(__file__).parent / "style/scorer.js")
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_math_renderer = "mathml"

autodoc_default_options = {"members": True, "show-inheritance": True, "member-order": "bysource"}
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 88
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
viewcode_line_numbers = True

sphinx_gallery_conf = {
    "examples_dirs": ["gallery", "../examples/dissertation"],
    "gallery_dirs": ["generated/gallery", "generated/dissertation"],
    "filename_pattern": r"\.py$",
    "download_all_examples": False,
    "show_signature": False,
    "show_memory": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "remove_config_comments": True,
    "abort_on_example_error": True,
    "reset_modules": ("matplotlib", "website.use_style"),
    "within_subsection_order": "FileNameSortKey",
    "thumbnail_size": (640, 360),
}
