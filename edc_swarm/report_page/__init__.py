"""The report page: one mission as a single HTML document that needs no network.

`Page.of` gathers what is shown, `render` puts it into the template. Animation and plots are drawn by
the small script beside this file; tables are plain HTML and need no script.
"""

from edc_swarm.report_page.data import Page
from edc_swarm.report_page.render import Assets, render

__all__ = ["Assets", "Page", "render"]
