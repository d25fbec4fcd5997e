"""The documentation site: `make docs` writes it to site/, with warnings as errors."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
# The code of this checkout, wherever Softaim is installed
sys.path[:0] = [str(ROOT), str(ROOT / "docs" / "_extensions")]

project = html_title = "Softaim"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc", "api", "mathml"]

# Pages are read from the root of the repository, so that a link such as ../README.md holds there and on the site
root_doc = "docs/index"
include_patterns = ["*.md", "docs/**"]
exclude_patterns = [path.name for path in ROOT.iterdir() if path.is_dir() and path.name != "docs"]  # saves time
exclude_patterns += ["docs/_*"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4  # links such as page.md#a-heading
nb_execution_mode = "force"  # pages that are notebooks run at each build, in a folder of their own
nb_execution_in_temp = nb_execution_raise_on_error = True
nb_execution_timeout = 600  # the first run compiles kernels

html_theme = "pydata_sphinx_theme"
html_theme_options = {"secondary_sidebar_items": ["page-toc"], "show_prev_next": False, "show_toc_level": 2}
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_additional_pages = {"index": "redirect.html"}  # the first page is docs/index.html
html_show_sourcelink = False
html_copy_source = False
smartquotes = False  # would turn the two dashes of --option into one
html_math_renderer = "mathml"
templates_path = [str(ROOT / "docs" / "_templates")]  # absolute: autosummary looks from the root

default_role = "py:obj"  # a name in backticks is a link where the site documents it, and code elsewhere
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 100
toc_object_entries_show_parents = "hide"
numpydoc_show_class_members = False  # autodoc lists them
