"""Settings of the documentation site: `make docs` builds it from the pages of this folder and of the project's top."""

from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

import edc_swarm

TOP = Path(__file__).resolve().parents[1]

project = "edc_swarm"
author = "The authors of edc_swarm"
version = release = edc_swarm.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinxcontrib.mermaid"]
root_doc = "docs/contents"
include_patterns = ["*.md", "docs/**", "recordings/README.md"]
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]
myst_enable_extensions = ["dollarmath"]
nb_execution_mode = "off"
nitpicky = True
html_theme = "furo"
html_title = "edc_swarm"
html_show_sphinx = False
html_copy_source = False


def _name_folders(app: Sphinx, document: nodes.document) -> None:
    """Turn links to folders of the project into their names: the site holds its pages and files, no folders."""
    del app
    page = Path(document["source"])
    for link in list(document.findall(nodes.Element)):
        target = link.get("reftarget") or link.get("refuri") or ""
        path = (page.parent / target.partition("#")[0]).resolve()
        if target and "://" not in target and path.is_dir() and path.is_relative_to(TOP):
            link.replace_self(nodes.literal("", str(path.relative_to(TOP)) + "/"))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the transform."""
    app.connect("doctree-read", _name_folders)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
