"""Configuration of the documentation: ``sphinx-build -W docs docs/_build``."""

import sys
from importlib import import_module, metadata
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from docutils.statemachine import StringList
from sphinx.ext.autosummary import Autosummary

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

project = "emgface"
author = "The emgface developers"
copyright = author
try:
    release = metadata.version("emgface")
except metadata.PackageNotFoundError:
    release = ""

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "myst_parser",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "_templates", "**/make.py", "changes"]
templates_path = ["_templates"]

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3

autosummary_generate = True
autosummary_imported_members = False
autosummary_ignore_module_all = True
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {}
napoleon_google_docstring = False
napoleon_numpy_docstring = True
napoleon_use_rtype = False
napoleon_use_ivar = True
napoleon_preprocess_types = False
default_role = "code"
python_use_unqualified_type_names = True

# Classes are documented where they are defined and re-exported by their packages, so that a bare
# name has several equivalent targets.
suppress_warnings = ["ref.python"]

html_theme = "furo"
html_title = "emgface"
html_static_path = ["_static"]
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0072b2", "color-brand-content": "#0072b2"},
    "dark_css_variables": {"color-brand-primary": "#56b4e9", "color-brand-content": "#56b4e9"},
}


def _plain_bars(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Escape vertical bars, so that ``|x|`` in a docstring is shown as an absolute value."""
    for k, line in enumerate(lines):
        parts = line.split("`")
        parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
        lines[k] = "`".join(parts)


class PublicNames(Autosummary):
    """Table of the public names of a package (its ``__all__``), each linked to where it is defined."""

    required_arguments = 1

    def run(self) -> list[Any]:
        """Make the table."""
        package = self.arguments[0]
        module = import_module(package)
        root = package.partition(".")[0]
        names: list[str] = []
        for name in sorted(module.__all__, key=str.lower):
            value = getattr(module, name)
            home = str(getattr(value, "__module__", ""))
            if not home.startswith(root) or not hasattr(value, "__name__"):
                # a constant does not say where it is defined
                loaded = (m for m in sys.modules if m.startswith(f"{root}.") and m != package)
                home = next(m for m in loaded if getattr(sys.modules[m], name, None) is value)
            names.append(f"~{home}.{name}")
        self.content = StringList(names, source=package)
        return super().run()


def _notebook_pages(app: Any) -> None:
    """Make the pages of the notebooks."""
    path = Path(__file__).with_name("gallery") / "make.py"
    spec = spec_from_file_location("gallery", path)
    assert spec is not None and spec.loader is not None
    gallery = module_from_spec(spec)
    spec.loader.exec_module(gallery)
    gallery.make()


def _own_branch(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Show the modules of its own branch next to a page; those of all take most of the build's time."""
    if "toctree" in context:
        whole = context["toctree"]
        context["toctree"] = lambda **options: whole(**{**options, "collapse": True})


def setup(app: Any) -> None:
    """Connect what is above."""
    app.connect("html-page-context", _own_branch, priority=400)  # before the theme
    app.add_directive("public-names", PublicNames)
    app.connect("builder-inited", _notebook_pages, priority=100)
    app.connect("autodoc-process-docstring", _plain_bars, priority=900)
