"""Pictures of the report page for README and docs: `python docs/screenshots.py` writes docs/pictures/page-*.webp.

It simulates 50 UAVs, of which the head is killed and another one frozen, makes the report, and opens it in Chromium
(apt install chromium-driver), in light and in dark. With FILE.html it takes pictures of that page instead. With the
same code, fonts and browser the pictures are the same.
"""

from __future__ import annotations

import argparse
import base64
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from processes.cli.main import main as edc_swarm

MISSION = ("--uavs", "50", "--fault", "kill head @10", "--fault", "freeze u007 @14 for 20", "--seed", "4")
AT_S = 9.0
"""Mission time that a picture shows."""
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--hide-scrollbars")


@contextmanager
def browser() -> Iterator[Any]:
    """Yield a browser without a window."""
    options, program, driver = webdriver.ChromeOptions(), shutil.which("chromium"), shutil.which("chromedriver")
    if program is None or driver is None:
        sys.exit("error: no chromium with its driver (apt install chromium-driver)")
    options.binary_location = program
    for flag in FLAGS:
        options.add_argument(flag)
    opened = webdriver.Chrome(options=options, service=Service(driver))
    try:
        yield opened
    finally:
        opened.quit()


def picture(opened: Any, page: Path, scheme: str, size_px: tuple[int, int], at_s: float, kind: str) -> bytes:
    """Return a picture of the top of the page at a mission time."""
    screen = {"width": size_px[0], "height": size_px[1], "deviceScaleFactor": 1, "mobile": False}
    opened.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    opened.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    )
    opened.get(page.resolve().as_uri())
    opened.execute_script(
        "const s = document.getElementById('slider'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))", at_s
    )
    quality = {"quality": 82} if kind == "webp" else {}
    taken = opened.execute_cdp_cmd("Page.captureScreenshot", {"format": kind, **quality})
    return base64.b64decode(taken["data"])


def report(folder: Path) -> Path:
    """Simulate the mission and return its page."""
    recording = folder / "mission.mcap"
    with redirect_stdout(StringIO()):
        edc_swarm(["sim", *MISSION, "--out", str(recording), "--no-viz", "--json"])
        edc_swarm(["report", str(recording)])
    return recording.with_suffix(".html")


def main() -> int:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0] if __doc__ else "")
    parser.add_argument("page", nargs="?", type=Path, help="FILE.html (that of the mission above)")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "pictures")
    parser.add_argument("--size", default="1280x800", help="width and height in pixels")
    parser.add_argument("--at", type=float, default=AT_S, help="mission time in seconds")
    parser.add_argument("--kind", default="webp", choices=["webp", "png"])
    options = parser.parse_args()
    width, _, height = options.size.partition("x")
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, browser() as opened:
        page = options.page or report(Path(folder))
        stem = options.page.stem if options.page else "page"
        for scheme in ("light", "dark"):
            path = options.out / f"{stem}-{scheme}.{options.kind}"
            path.write_bytes(picture(opened, page, scheme, (int(width), int(height)), options.at, options.kind))
            print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
