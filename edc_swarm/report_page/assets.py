"""The source files of the report page, as they are installed."""

from __future__ import annotations

from importlib.resources import files

from edc_swarm.report_page.render import SCRIPTS, Assets


def page_assets() -> Assets:
    """Return the template, the style and the script of the page."""
    folder = files("edc_swarm.report_page")
    template, style = ((folder / f"page.{kind}").read_text("utf-8") for kind in ("html", "css"))
    return Assets(template, style, "\n".join((folder / name).read_text("utf-8") for name in SCRIPTS))
