"""The report page as one HTML document, with tables, data and script."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import cycle
from string import Template
from typing import Any

import msgspec

from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, headline, safety
from edc_swarm.analysis.metrics import Metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.foreign_text import MAX_LINE, shown
from edc_swarm.report_page.data import Page
from edc_swarm.report_page.flight_rows import HEADINGS, cells

MAX_WHERE = 20
MAX_FACT = 300
MAX_ZONE_ROWS = 30
FACTS = ("command", "commit", "clock", "machine")


SCRIPTS = ("map.js", "plots.js", "page.js")
"""Files of the script, in the order in which they follow one another."""


@dataclass(frozen=True, slots=True)
class Assets:
    """The source files of the page: `page.html`, `page.css` and the script, `SCRIPTS` one after another."""

    template: str
    style: str
    script: str


@dataclass(frozen=True, slots=True)
class Shown:
    """One recording on the page: its data, metrics and verdicts, and facts of its run."""

    page: Page
    metrics: Metrics
    guarantees: Sequence[GuaranteeResult]
    run: Mapping[str, str]


def render(
    page: Page, metrics: Metrics, guarantees: Sequence[GuaranteeResult], run: Mapping[str, str], assets: Assets
) -> str:
    """Return the whole document of one recording."""
    return render_all([Shown(page, metrics, guarantees, run)], assets)


def render_all(recordings: Sequence[Shown], assets: Assets) -> str:
    """Return the whole document of one recording, or of two side by side."""
    first = recordings[0]
    names = [escape(f"{each.page.name}, {len(each.page.uavs)} UAVs") for each in recordings]
    return Template(assets.template).substitute(
        title=" and ".join(names),
        headlines="".join(_headline(each, label) for each, label in _labelled(recordings)),
        style=assets.style,
        script=assets.script,
        maps="".join(_map(each, label) for each, label in _labelled(recordings)),
        stories="".join(
            f'<ol class="events" tabindex="0" aria-label="Events {label}"></ol>' for _, label in _labelled(recordings)
        ),
        tables=_tables(first) if len(recordings) == 1 else _comparison(recordings),
        flights="".join(_flights(each.page, label) for each, label in _labelled(recordings)),
        of_first=" (of A)" if len(recordings) > 1 else "",
        zone_legend=_zone_legend([each.page for each in recordings]),
        metrics_json=_embedded(_printable(msgspec.to_builtins(first.metrics))),
        data=_embedded(first.page),
        other_data="".join(
            f'<script type="application/json" id="data-b">{_embedded(each.page)}</script>\n' for each in recordings[1:]
        ),
    )


def _labelled(recordings: Sequence[Shown]) -> Iterable[tuple[Shown, str]]:
    """Return the recordings with A and B, a single one with no label."""
    return zip(recordings, "AB" if len(recordings) > 1 else [""], strict=False)


def _headline(each: Shown, label: str) -> str:
    words = (
        f"{label + ': ' if label else ''}{_done(each.metrics)}; {safety(each.guarantees)}; {headline(each.guarantees)}"
    )
    broken = ' class="broken"' if any(result.broken for result in each.guarantees) else ""
    return f"<p{broken}>{escape(words)}</p>\n"


def _done(metrics: Metrics) -> str:
    if metrics.arrived is None or metrics.duration_s is None:
        return f"The record does not tell how many of {metrics.uavs} UAVs arrived"
    if metrics.goals_per_minute is not None:
        return f"{metrics.uavs} UAVs reached {metrics.goals_reached} goals in {metrics.duration_s:g} s"
    unknown = f", {len(metrics.unknown)} unknown" if metrics.unknown else ""
    return f"{metrics.arrived} of {metrics.uavs} UAVs arrived within {metrics.duration_s:g} s{unknown}"


def _map(each: Shown, label: str) -> str:
    """Return the map; one of two has the command that flew it, since two missions often have one name."""
    own = "map" if label in {"", "A"} else "map-b"
    flown = each.run.get("command") or each.page.name
    caption = f"<figcaption>{label}: {escape(flown[:MAX_FACT])}</figcaption>" if label else ""
    words = "The swarm from above; its state is in the line below and in the list of events"
    canvas = f'<canvas id="{own}" class="map" tabindex="0" role="img" aria-label="{words}"></canvas>'
    return f"<figure>{caption}{canvas}</figure>\n"


def _tables(each: Shown) -> str:
    page, run = each.page, each.run
    faults = _rows((f"{fault.time_s:.2f} s", fault.text) for fault in page.faults) or _rows([("none", "")])
    facts = _rows((name, run[name][:MAX_FACT]) for name in FACTS if run.get(name))
    return (
        f'<div><h2>Metrics</h2><table id="metrics">{_rows(metric_rows(each.metrics), _listed)}</table></div>\n'
        f'<div><h2>Guarantees</h2><table id="guarantees">{"".join(map(_guarantee, each.guarantees))}</table></div>\n'
        f'<div><h2>Faults</h2><table id="faults">{faults}</table></div>\n'
        f'<div><h2>The run</h2><table id="facts">{facts}</table></div>\n{_zones(page)}'
    )


def _comparison(recordings: Sequence[Shown]) -> str:
    """Return the table of differences of two recordings: metrics, then verdicts."""
    first, second = recordings
    ours, theirs = (dict(metric_rows(each.metrics)) for each in recordings)
    rows = [_difference(name, ours.get(name, "-"), theirs.get(name, "-")) for name in dict.fromkeys([*ours, *theirs])]
    verdicts = {result.guarantee: result.words for result in second.guarantees}
    for result in first.guarantees:
        name = f"{result.guarantee} {result.title}"
        rows += [_difference(name, result.words, verdicts.get(result.guarantee, "-"))]
    head = "<thead><tr><th></th><th scope=col>A</th><th scope=col>B</th></tr></thead>"
    table = f'<table id="differences">{head}<tbody>{"".join(rows)}</tbody></table>'
    return f'<div class="differences"><h2>Differences</h2>{table}</div>\n'


def _difference(name: str, ours: str, theirs: str) -> str:
    changed = ' class="changed"' if ours != theirs else ""
    return f"<tr{changed}><th scope=row>{escape(name)}</th><td>{_listed(ours)}</td><td>{_listed(theirs)}</td></tr>\n"


def _flights(page: Page, label: str) -> str:
    own = "flights" if label in {"", "A"} else "flights-b"
    first, *others = HEADINGS
    head = "".join(f"<th scope=col>{each}</th>" for each in (first, *["cluster"] * bool(page.clusters), *others))
    clusters = [[page.clusters[number]] for number in page.cluster] or [[]] * len(page.rows)
    body = "".join(
        f"<tr><th scope=row>{escape(name)}</th>{''.join(f'<td>{escape(cell)}</td>' for cell in (*cluster, *rest))}</tr>"
        for cluster, (name, *rest) in zip(clusters, map(cells, page.rows), strict=True)
    )
    title = f"<h3>{label}</h3>" if label else ""
    table = f'<table id="{own}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
    return f'{title}<div class="wrap">{table}</div>\n'


def _zone_legend(pages: Sequence[Page]) -> str:
    """Return the entries of the legend for the kinds of zones on the maps, and for the clusters of the first."""
    words = {"inclusion": "fence (inclusion zone)", "exclusion": "exclusion zone"}
    kinds = {zone.kind for page in pages for zone in page.zones}
    zones = [f'<li><i class="{kind}"></i>{said}</li>\n' for kind, said in words.items() if kind in kinds]
    colours = cycle(pages[0].cluster_colours)
    clusters = [
        f'<li><i style="border: 3px solid {colour}; background: none"></i>cluster {escape(name)}</li>\n'
        for name, colour in zip(pages[0].clusters, colours, strict=False)
    ]
    return "".join([*zones, *clusters])


def _zones(page: Page) -> str:
    """Return the table of the zones; no table if there are none."""
    if not page.zones:
        return ""
    rows = [(zone.name, f"{zone.kind}, {zone.said}") for zone in page.zones[:MAX_ZONE_ROWS]]
    if len(page.zones) > MAX_ZONE_ROWS:
        rows.append(("...", f"{len(page.zones)} in all"))
    return f"<div><h2>Zones</h2><table id=zones>{_rows(rows)}</table></div>\n"


def _broken(text: str) -> str:
    """Return text escaped for HTML, with a possible line break after each comma, since long lists have no space."""
    return re.sub(r",(?=\S)", ",<wbr>", escape(shown(text, MAX_LINE)))


def _listed(text: str) -> str:
    """Return text escaped for HTML, with each of its parts on a line of its own, such as a UAV with its reason."""
    return ";<br>".join(map(_broken, text.split("; ")))


def _rows(rows: Iterable[tuple[str, str]], cell: Callable[[str], str] = _broken) -> str:
    return "".join(f"<tr><th scope=row>{escape(name)}</th><td>{cell(value)}</td></tr>\n" for name, value in rows)


def _guarantee(result: GuaranteeResult) -> str:
    where = [escape(shown(line, MAX_LINE)) for line in (*result.where[:MAX_WHERE], *result.notes[:MAX_WHERE])]
    if len(result.where) > MAX_WHERE:
        where.append(f"... {escape(result.counted)}")
    items = f"<ul>{''.join(f'<li>{line}</li>' for line in where)}</ul>" if where else ""
    verdict = f'<span class="{result.status}">{escape(result.words)}</span>'
    return f"<tr><th scope=row>{result.guarantee} {escape(result.title)}</th><td>{verdict}{items}</td></tr>\n"


def _embedded(value: object) -> str:
    """Return JSON without the characters that could end its script element."""

    return msgspec.json.encode(value).decode().replace("<", "\\u003c")


def _printable(value: Any) -> Any:
    """Return plain data with each text in it cut and escaped as `shown` does."""
    match value:
        case str():
            return shown(value, MAX_LINE)
        case list():
            return [_printable(each) for each in value]
        case dict():
            return {name: _printable(each) for name, each in value.items()}
        case _:
            return value
