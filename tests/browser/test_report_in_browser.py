"""The report page in a real browser draws, plays, and reports no error."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from processes.cli.main import main

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PATIENCE_S = 60

pytestmark = [
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="no Chromium with its driver (apt install chromium-driver)"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
MISSIONS = {
    "10": ["--fault", "kill head @8"],
    "zones": ["scenarios/courtyard.toml", "--planner", "straight", "--fault", "kill head @8"],
    "50": ["--uavs", "50", "--area", "40000", "--speed-max", "20", "--fault", "freeze u007 @4 for 6"],
}


@pytest.fixture(scope="module", params=MISSIONS)
def page(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of a mission of 10 UAVs, of one with zones, and of one of 50 UAVs."""
    recording = tmp_path_factory.mktemp("report") / "run.mcap"
    main(["sim", *MISSIONS[request.param], "--out", str(recording), "--no-viz", "--json"])
    assert main(["report", str(recording)]) == 0
    return recording.with_suffix(".html")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Yield a browser with an empty profile."""
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    profile = tmp_path_factory.mktemp("profile")
    for argument in (*QUIET, f"--user-data-dir={profile}", "--window-size=1400,1700"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
    yield driver
    driver.quit()


def test_the_page_draws_and_its_slider_moves_everything(page: Path, browser: Any) -> None:
    """The console is empty, there are a map and five plots, and another time gives another picture."""
    browser.get(page.as_uri())
    assert len(browser.find_elements(By.CSS_SELECTOR, "#plots svg")) == 5
    before = browser.execute_script("return document.getElementById('map').toDataURL()")
    seek(browser, 3.0)
    after = browser.execute_script("return document.getElementById('map').toDataURL()")
    assert before != after
    assert "3.0 s" in browser.find_element(By.ID, "clock").text
    assert browser.get_log("browser") == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_exclusion_zones_are_drawn_in_their_colour(page: Path, browser: Any, scheme: str) -> None:
    """The map has the colour of the legend's exclusion zones if the mission has some; states have that colour too."""
    feature = {"name": "prefers-color-scheme", "value": scheme}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
    browser.get(page.as_uri())
    count = browser.execute_script(
        """
        const amber = getComputedStyle(document.documentElement).getPropertyValue("--amber").trim();
        const wanted = [1, 3, 5].map((at) => parseInt(amber.slice(at, at + 2), 16));
        const map = document.getElementById("map");
        const { data } = map.getContext("2d").getImageData(0, 0, map.width, map.height);
        let count = 0;
        const isNear = (i) => data[i + 3] > 0 && wanted.every((value, n) => Math.abs(value - data[i + n]) < 3);
        for (let i = 0; i < data.length; i += 4) count += isNear(i);
        return count;
        """
    )
    excludes = browser.execute_script("return document.querySelectorAll('.legend .exclusion').length > 0")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert count > 100 or not excludes
    assert excludes == ("pond" in page.read_text(encoding="utf-8"))


def test_nothing_is_cut_off_or_lies_over_another(page: Path, browser: Any) -> None:
    """At every width nothing exceeds the window, and no two texts of a plot overlap."""
    for width in (2200, 1400, 1000, 620, 400):
        screen = {"width": width, "height": 1500, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
        browser.get(page.as_uri())
        seek(browser, 3.0)
        assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth")
        assert browser.execute_script(OVERLAPPING_TEXTS) == []
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_plots_say_their_values_at_the_time_of_the_slider(page: Path, browser: Any) -> None:
    """A plot shows the last value at or before the slider's time, as in its data."""
    browser.get(page.as_uri())
    seek(browser, 3.2)
    data = json.loads(browser.execute_script("return document.getElementById('data').textContent"))
    said = [each.text for each in browser.find_elements(By.CSS_SELECTOR, "#plots text.now")]
    for plot, words in zip(data["plots"], said, strict=True):
        last = [[y for x, y in zip(series["x"], series["y"], strict=True) if x <= 3.2][-1] for series in plot["series"]]
        assert [float(word) for word in words.split(", ")] == pytest.approx(last, rel=5e-3)


def test_values_stand_in_the_order_of_the_legend(page: Path, browser: Any, tmp_path: Path) -> None:
    """The legend alone tells median and greatest apart."""
    html = page.read_text(encoding="utf-8")
    (text,) = re.findall(r'<script[^>]*id="data"[^>]*>(.*?)</script>', html, re.DOTALL)
    data = json.loads(text)
    (index,) = [i for i, plot in enumerate(data["plots"]) if len(plot["series"]) == 2]
    wanted = {series["name"]: 10.0 + n for n, series in enumerate(data["plots"][index]["series"])}
    for series in data["plots"][index]["series"]:
        series["y"] = [wanted[series["name"]]] * len(series["y"])
    changed = tmp_path / "page.html"
    changed.write_text(html.replace(text, json.dumps(data)), encoding="utf-8")
    browser.get(changed.as_uri())
    seek(browser, 3.2)
    svg = browser.find_elements(By.CSS_SELECTOR, "#plots svg")[index]
    said = svg.find_element(By.CSS_SELECTOR, "text.now").text
    names = [text for text in svg.find_elements(By.CSS_SELECTOR, "text") if text.text in wanted]
    legend = [text.text for text in sorted(names, key=lambda text: text.rect["x"])]
    assert [float(word) for word in said.split(", ")] == [wanted[name] for name in legend]


def test_playing_moves_the_time_until_it_is_paused(page: Path, browser: Any) -> None:
    """The button has the name of its next action."""
    browser.get(page.as_uri())
    seek(browser, 0.0)
    play = browser.find_element(By.ID, "play")
    play.click()
    assert play.text == "Pause"
    WebDriverWait(browser, PATIENCE_S).until(lambda _: slider(browser) > 0.3)
    play.click()
    stopped = slider(browser)
    browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
    assert slider(browser) == stopped
    assert play.text == "Play"
    assert browser.get_log("browser") == []


def test_a_click_or_a_drag_on_a_plot_goes_there_and_faults_are_marked(page: Path, browser: Any) -> None:
    """This works on every plot, and faults are marked on every plot and below the slider."""
    browser.get(page.as_uri())
    assert len(browser.find_elements(By.CSS_SELECTOR, "#plots line.fault")) == 5
    assert len(browser.find_elements(By.CSS_SELECTOR, "#marks polygon.fault")) == 1
    plot = browser.find_element(By.CSS_SELECTOR, "#plots svg")
    plot.click()
    clicked = slider(browser)
    assert clicked > 1.0
    webdriver.ActionChains(browser).click_and_hold(plot).move_by_offset(60, 0).release().perform()
    dragged = slider(browser)
    assert dragged > clicked
    webdriver.ActionChains(browser).move_to_element(plot).perform()
    assert slider(browser) == dragged


def test_the_dark_scheme_is_dark(page: Path, browser: Any) -> None:
    """The page and its canvas follow the system's colour scheme."""
    browser.get(page.as_uri())
    light = browser.execute_script("return document.getElementById('map').toDataURL()")
    features = [{"name": "prefers-color-scheme", "value": "dark"}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    paper = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
    assert max(int(part) for part in paper.strip("rgb()").split(",")) < 60
    drawn = "return document.getElementById('map').toDataURL()"
    WebDriverWait(browser, PATIENCE_S).until(lambda _: browser.execute_script(drawn) != light)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_the_page_opens_in_mid_flight_and_an_event_goes_to_its_time(page: Path, browser: Any) -> None:
    """The newest event is marked, and a click on another one moves the time."""
    browser.get(page.as_uri())
    assert slider(browser) > 0
    data = json.loads(browser.execute_script("return document.getElementById('data').textContent"))
    shown = [told for told in data["story"] if told["level"] != "detail"]
    (index,) = [n for n, told in enumerate(shown) if told["kind"] == "fault"]
    buttons = [each for each in browser.find_elements(By.CSS_SELECTOR, "ol.events button") if each.is_displayed()]
    assert len(buttons) == len(shown)
    browser.execute_script("arguments[0].click()", buttons[index])
    assert slider(browser) == pytest.approx(shown[index]["time_s"], abs=1e-3)
    assert "now" in browser.find_element(By.CSS_SELECTOR, "ol.events li.now").get_attribute("class")
    seek(browser, data["end_s"])
    assert browser.execute_script(IN_SIGHT, "ol.events", "ol.events li.now")


def test_an_event_goes_to_the_state_that_it_tells(page: Path, browser: Any) -> None:
    """A UAV that is killed or frozen shows it at the time of the event, although the record shows it a slot later."""
    browser.get(page.as_uri())
    data = json.loads(browser.execute_script("return document.getElementById('data').textContent"))
    shown = [told for told in data["story"] if told["level"] != "detail"]
    (index,) = [n for n, told in enumerate(shown) if told["kind"] in {"dead", "frozen"}]
    buttons = [each for each in browser.find_elements(By.CSS_SELECTOR, "ol.events button") if each.is_displayed()]
    browser.execute_script("arguments[0].click()", buttons[index])
    uav = data["uavs"][shown[index]["uavs"][0]]
    assert browser.find_element(By.ID, "detail").text.startswith(f"{uav}: {shown[index]['kind']}; ")


def test_zoom_and_follow_change_the_map(page: Path, browser: Any) -> None:
    """Following says the state of the UAV, and `all` shows everything again."""
    drawn = "return document.getElementById('map').toDataURL()"
    browser.get(page.as_uri())
    seek(browser, 3.0)
    whole = browser.execute_script(drawn)
    browser.find_element(By.ID, "zoom-in").click()
    zoomed = browser.execute_script(drawn)
    assert zoomed != whole
    browser.execute_script(
        "const f = document.getElementById('follow'); f.value = '1'; f.dispatchEvent(new Event('change'))"
    )
    followed = browser.execute_script("return document.getElementById('follow').selectedOptions[0].textContent").strip()
    assert followed
    assert browser.find_element(By.ID, "detail").text.startswith(f"{followed}: ")
    assert browser.execute_script(drawn) not in {whole, zoomed}
    browser.find_element(By.ID, "zoom-all").click()
    assert browser.find_element(By.ID, "detail").text == ""
    assert browser.execute_script(drawn) == whole
    assert browser.get_log("browser") == []


def test_keys_seek_and_zoom_and_a_drag_moves_the_map(page: Path, browser: Any) -> None:
    """Keys work, whatever button or slider was used last; a drag is no click, so it follows nobody."""
    drawn = "return document.getElementById('map').toDataURL()"
    browser.get(page.as_uri())
    data = json.loads(browser.execute_script("return document.getElementById('data').textContent"))
    seek(browser, 3.0)
    whole = browser.execute_script(drawn)
    press(browser, "+")
    zoomed = browser.execute_script(drawn)
    map_ = browser.find_element(By.ID, "map")
    webdriver.ActionChains(browser).click_and_hold(map_).move_by_offset(40, 25).release().perform()
    assert len({whole, zoomed, browser.execute_script(drawn)}) == 3
    assert browser.find_element(By.ID, "detail").text == ""
    # Away from the map, on which the pointer would show the name of whatever is under it.
    webdriver.ActionChains(browser).move_to_element(browser.find_element(By.ID, "zoom-all")).perform()
    press(browser, "0")
    assert browser.execute_script(drawn) == whole
    press(browser, "ArrowRight")
    assert slider(browser) == pytest.approx(3.0 + data["slot_s"])
    for focused in ("play", "slider"):
        before = slider(browser)
        browser.find_element(By.ID, focused).send_keys(Keys.ARROW_RIGHT)
        assert slider(browser) == pytest.approx(before + data["slot_s"])
    press(browser, "Home")
    assert slider(browser) == 0
    press(browser, "n")
    told = [each["time_s"] for each in data["story"] if each["level"] != "detail" and each["time_s"] > 0]
    assert slider(browser) == pytest.approx(told[0])
    assert browser.get_log("browser") == []


def test_the_plots_show_a_part_of_the_mission(page: Path, browser: Any) -> None:
    """`10 s around now` and `whole mission` say so on the overview."""
    words = "return document.querySelector('#overview text:nth-of-type(2)').textContent"
    browser.get(page.as_uri())
    seek(browser, 6.0)
    browser.find_element(By.ID, "span-all").click()
    whole = browser.execute_script(words)
    browser.find_element(By.ID, "span-near").click()
    assert browser.execute_script(words) == "plots: 1.0 to 11.0 s" != whole


def test_two_recordings_stand_side_by_side(tmp_path: Path, browser: Any) -> None:
    """There are two maps, two lists of events, and a table of what differs."""
    paths = [tmp_path / f"{name}.mcap" for name in "ab"]
    for path, planner in zip(paths, ("straight", "edc"), strict=True):
        main(["sim", "--uavs", "3", "--planner", planner, "--out", str(path), "--no-viz", "--json"])
    out = tmp_path / "both.html"
    assert main(["report", *map(str, paths), "-o", str(out)]) == 0
    browser.get(out.as_uri())
    assert len(browser.find_elements(By.CSS_SELECTOR, "canvas.map")) == 2
    lists = browser.find_elements(By.CSS_SELECTOR, "ol.events")
    assert [len(each.find_elements(By.CSS_SELECTOR, "li")) > 0 for each in lists] == [True, True]
    seek(browser, 3.0)
    assert re.search(r"A: head u\d+; B: head u\d+$", browser.find_element(By.ID, "clock").text)
    table = browser.find_element(By.ID, "differences").text
    assert "least gap" in table
    widths = browser.execute_script(
        "return [...document.querySelectorAll('#differences thead th')].map((each) => each.clientWidth)"
    )
    assert widths[1] == widths[2]
    assert "G3 Separation" in table
    assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth")
    assert browser.execute_script(OVERLAPPING_TEXTS) == []
    assert browser.get_log("browser") == []


def seek(browser: Any, time_s: float) -> None:
    """Move the slider like a user."""
    browser.execute_script(
        "const s = document.getElementById('slider'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))",
        time_s,
    )


def press(browser: Any, key: str) -> None:
    """Press a key while nothing has the focus."""
    browser.execute_script("document.activeElement.blur()")
    names = {"ArrowRight": Keys.ARROW_RIGHT, "Home": Keys.HOME}
    webdriver.ActionChains(browser).send_keys(names.get(key, key)).perform()


def slider(browser: Any) -> float:
    """Return the slider's position."""
    return float(browser.execute_script("return Number(document.getElementById('slider').value)"))


IN_SIGHT = """
const [outer, inner] = [...arguments].map((found) => document.querySelector(found).getBoundingClientRect());
return inner.top >= outer.top && inner.bottom <= outer.bottom + 1;
"""

OVERLAPPING_TEXTS = """
const bad = [];
for (const svg of document.querySelectorAll("#plots svg")) {
  const area = svg.getBoundingClientRect();
  const texts = [...svg.querySelectorAll("text")].map((t) => [t.textContent, t.getBoundingClientRect()]);
  texts.forEach(([words, a], i) => {
    const inside = a.left > area.left - 1 && a.right < area.right + 1 && a.bottom < area.bottom + 1;
    if (!inside) bad.push(words + " is cut off");
    for (const [other, b] of texts.slice(i + 1)) {
      const across = a.left < b.right && b.left < a.right;
      if (across && a.top + 2 < b.bottom && b.top + 2 < a.bottom) bad.push(words + " | " + other);
    }
  });
}
return bad;
"""
