"""Pictures of a recording in Foxglove Studio in a headless browser, and the problems that the viewer reports.

Foxglove Studio 1.48 is the last version with packages of its parts. There are none of its successor Lichtblick nor of
today's Foxglove, so neither is looked at here. The source of Lichtblick has the settings of panels that the layout
states. The script needs Chromium with its driver and, in any folder:

    npm install @foxglove/studio-base@1.48.0 react@17.0.2 react-dom@17.0.2
    python benchmarks/viewer/look.py FOLDER/node_modules FILE.mcap [--at 0.3 0.6] [--size 1600x1000]

Pictures are FILE-1.png, FILE-2.png, ... in the current folder, and FILE-tabs.png with the other tabs in front; the exit
status is 1 if the viewer reports a problem.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.by import By

from edc_swarm.recording.mcap_file import McapFile
from edc_swarm.viz.layout import LAYOUT_ATTACHMENT

LOADED_S = 25.0
DRAWN_S = 6.0
BAR_PX = (15, 57)
"""Distances of the time bar from the left and right edge, and from the bottom, in pixels."""
FLAGS = ("--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


class Handler(SimpleHTTPRequestHandler):
    """A server of the host page, the packages, the recording and its layout, with HTTP ranges for the viewer."""

    def __init__(self, *arguments: Any, modules: Path, recording: Path, layout: bytes) -> None:
        self._modules, self._recording, self._layout = modules, recording, layout
        super().__init__(*arguments)

    def do_HEAD(self) -> None:
        self._answer(body=False)

    def do_GET(self) -> None:
        self._answer(body=True)

    def log_message(self, *_: Any) -> None:
        pass

    def _answer(self, *, body: bool) -> None:
        path = self.path.partition("?")[0]
        data = self._layout if path == "/layout.json" else self._file(path).read_bytes()
        asked = re.match(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        begin, end = (int(asked[1]), int(asked[2] or len(data) - 1) + 1) if asked else (0, len(data))
        self.send_response(206 if asked else 200)
        self.send_header("Content-Type", self.guess_type(path) if path != "/" else "text/html")
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Content-Length", str(end - begin))
        if asked:
            self.send_header("Content-Range", f"bytes {begin}-{end - 1}/{len(data)}")
        self.end_headers()
        if body:
            with suppress(BrokenPipeError, ConnectionResetError):
                self.wfile.write(data[begin:end])

    def _file(self, path: str) -> Path:
        if path.startswith("/npm/"):
            return self._modules / path.removeprefix("/npm/")
        return self._recording if path == "/recording.mcap" else Path(__file__).with_name("host.html")


@contextmanager
def served(modules: Path, recording: Path) -> Iterator[str]:
    file = McapFile(recording)
    for _ in file.messages():
        pass
    handler = partial(Handler, modules=modules, recording=recording, layout=file.attachments[LAYOUT_ATTACHMENT][1])
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://localhost:{server.server_port}"
        server.shutdown()


def look(browser: Any, address: str, shares: list[float], stem: str) -> list[str]:
    """Take the pictures, and return the texts under the viewer's "Problems"."""
    browser.get(f"{address}/?ds=remote-file&ds.url={address}/recording.mcap")
    time.sleep(LOADED_S)
    browser.find_element(By.XPATH, "//button[contains(., 'Problems')]").click()
    time.sleep(1.0)
    problems = [] if "No problems found" in browser.page_source else [browser.find_element(By.TAG_NAME, "body").text]
    browser.execute_script("arguments[0].click()", browser.find_element(By.CSS_SELECTOR, "[role=tab]"))
    for tip in browser.find_elements(By.CSS_SELECTOR, "[role=tooltip] button"):
        tip.click()
    for number, share in enumerate(shares, start=1):
        seek(browser, share)
        browser.save_screenshot(f"{stem}-{number}.png")
    layout = browser.execute_script("return fetch('/layout.json').then((answer) => answer.json())")
    for tabs in (panel["tabs"] for panel in layout["configById"].values() if "tabs" in panel):
        browser.find_element(By.XPATH, f"//input[@value='{tabs[-1]['title']}']/../..").click()
    time.sleep(DRAWN_S)
    browser.save_screenshot(f"{stem}-tabs.png")
    return problems


def seek(browser: Any, share: float) -> None:
    width, height = browser.execute_script("return [innerWidth, innerHeight]")
    (edge, bottom), actions = BAR_PX, ActionBuilder(browser)
    pointer: Any = actions.pointer_action  # without types
    pointer.move_to_location(int(edge + share * (width - 2 * edge)), height - bottom)
    pointer.click()
    pointer.move_to_location(width // 4, height - bottom // 2)
    actions.perform()
    time.sleep(DRAWN_S)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("modules", type=Path)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--at", type=float, nargs="+", default=[0.3], help="shares of the recording, 0 to 1")
    parser.add_argument("--size", default="1600x1000")
    options = parser.parse_args()
    if not (options.modules / "@foxglove" / "studio-base").is_dir():
        parser.error(f"{options.modules} must be the node_modules with @foxglove/studio-base (npm install, see above)")
    chrome = webdriver.ChromeOptions()
    for flag in (*FLAGS, f"--window-size={options.size.replace('x', ',')}"):
        chrome.add_argument(flag)
    browser = webdriver.Chrome(options=chrome, service=Service(shutil.which("chromedriver")))
    try:
        with served(options.modules, options.recording) as address:
            problems = look(browser, address, options.at, options.recording.stem)
    finally:
        browser.quit()
    print("\n".join(problems) or "the viewer reports no problems")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
