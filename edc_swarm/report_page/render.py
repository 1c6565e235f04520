"""The report page as one HTML document, with tables, data and script."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from string import Template
from typing import Any

import msgspec

from edc_swarm.analysis.guarantees.verdict import GuaranteeResult, headline
from edc_swarm.analysis.metrics import Metrics
from edc_swarm.analysis.tables import metric_rows
from edc_swarm.foreign_text import MAX_LINE, shown
from edc_swarm.report_page.data import Page

MAX_WHERE = 20
MAX_FACT = 300
MAX_ZONE_ROWS = 30
FACTS = ("command", "commit", "clock", "machine")


@dataclass(frozen=True, slots=True)
class Assets:
    """The source files of the page: `page.html`, `page.css` and `page.js`."""

    template: str
    style: str
    script: str


def render(
    page: Page, metrics: Metrics, guarantees: Sequence[GuaranteeResult], run: dict[str, str], assets: Assets
) -> str:
    """Return the whole document."""
    return Template(assets.template).substitute(
        title=escape(page.name),
        subtitle=escape(_subtitle(metrics, guarantees)),
        style=assets.style,
        script=assets.script,
        metrics=_rows(metric_rows(metrics)),
        guarantees="".join(_guarantee(result) for result in guarantees),
        faults=_rows((f"{fault.time_s:.2f} s", fault.text) for fault in page.faults) or _rows([("none", "")]),
        zone_legend=_zone_legend(page),
        zones=_zones(page),
        facts=_rows((name, run[name][:MAX_FACT]) for name in FACTS if run.get(name)),
        metrics_json=_embedded(_printable(msgspec.to_builtins(metrics))),
        data=_embedded(page),
    )


def _subtitle(metrics: Metrics, guarantees: Sequence[GuaranteeResult]) -> str:
    arrived = f"{metrics.arrived} of {metrics.uavs} UAVs arrived in {metrics.duration_s:g} s"
    return f"{arrived}; {headline(guarantees)}"


def _zone_legend(page: Page) -> str:
    """Return the entries of the legend for the kinds of zones on the map."""
    words = {"inclusion": "fence (inclusion zone)", "exclusion": "exclusion zone"}
    kinds = {zone.kind for zone in page.zones}
    return "".join(f'<li><i class="{kind}"></i>{said}</li>\n' for kind, said in words.items() if kind in kinds)


def _zones(page: Page) -> str:
    """Return the table of the zones; no table if there are none."""
    if not page.zones:
        return ""
    rows = [(zone.name, f"{zone.kind}, {zone.said}") for zone in page.zones[:MAX_ZONE_ROWS]]
    if len(page.zones) > MAX_ZONE_ROWS:
        rows.append(("...", f"{len(page.zones)} in all"))
    return f"<div><h2>Zones</h2><table id=zones>{_rows(rows)}</table></div>\n"


def _rows(rows: Iterable[tuple[str, str]]) -> str:
    return "".join(f"<tr><th scope=row>{escape(name)}</th><td>{_broken(value)}</td></tr>\n" for name, value in rows)


def _broken(text: str) -> str:
    """Return text escaped for HTML, with a possible line break after each comma, since long lists have no space."""
    return re.sub(r",(?=\S)", ",<wbr>", escape(shown(text, MAX_LINE)))


def _guarantee(result: GuaranteeResult) -> str:
    where = [escape(shown(line, MAX_LINE)) for line in (*result.where[:MAX_WHERE], *result.notes[:MAX_WHERE])]
    if len(result.where) > MAX_WHERE:
        where.append(f"... {len(result.where)} in all")
    items = f"<ul>{''.join(f'<li>{line}</li>' for line in where)}</ul>" if where else ""
    verdict = f'<span class="{result.status}">{result.status.replace("-", " ")}</span>'
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
