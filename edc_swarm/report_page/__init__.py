"""The report page: one mission as a single HTML document that needs no network.

This package decides what the page shows; the numbers come from `analysis`. It imports that, `recording`, `protocol`
and `foreign_text`. Animation and plots are drawn by `page.js` beside this file; tables are plain HTML and need no
script. Open `render` first.
"""
