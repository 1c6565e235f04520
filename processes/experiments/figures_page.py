"""The HTML page of the figures, with the paper's claim and the finding for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from edc_swarm.experiments.figures.catalogue import LONG, LONG_RUN, PRINTED_UAVS, TIME_FORMS, Figure
from edc_swarm.experiments.figures.findings import FigureFinding
from edc_swarm.experiments.figures.table import Row
from edc_swarm.experiments.sweeps import Run

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #111; }
section { border-top: 1px solid #ccc; padding: 1rem 0; }
img { width: 100%; max-width: 42rem; display: block; }
table { border-collapse: collapse; font-size: 0.85rem; font-variant-numeric: tabular-nums; }
td, th { padding: 0.15rem 0.8rem 0.15rem 0; text-align: right; }
td:first-child, th:first-child { text-align: left; }
code { font-size: 0.85rem; }
.yes { color: #005a3c; } .no { color: #a33b00; }
p { overflow-wrap: anywhere; }
"""
META = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
TITLE = "The paper's figures, computed again"
BILL_COLUMNS = {
    "uav": "UAV",
    "cruise_s": "cruise [s]",
    "cruise_j": "cruise [J]",
    "hover_s": "hover [s]",
    "hover_j": "hover [J]",
    "radio_j": "radio [J]",
    "compute_j": "compute [J]",
    "total_j": "total [J]",
    "left_j": "left [J]",
    "slots_led": "slots led",
}


def page(
    figures: Sequence[Figure],
    findings: Mapping[str, FigureFinding],
    rows: Mapping[str, Sequence[Row]],
    results: Mapping[str, Any],
    runs: Sequence[Run],
    facts: Mapping[str, str],
) -> str:
    """Return the whole page as HTML."""
    parts = [_introduction(facts), _summary(figures, findings), _forms(results, runs)]
    parts += [_section(figure, findings[figure.name], rows[figure.name]) for figure in figures]
    if LONG_RUN.key in results:
        parts.append(_long(results[LONG_RUN.key]))
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head>{META}<title>{TITLE}</title>'
        f"<style>{STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def _files(name: str) -> str:
    """Return links to the files of a figure."""
    return " ".join(f'<a href="{name}.{kind}">{kind.upper()}</a>' for kind in ("png", "svg", "pdf", "csv"))


def _introduction(facts: Mapping[str, str]) -> str:
    return (
        f"<h1>{TITLE}</h1><p>Section IV of S. Ouahouah, J. Prados-Garzon, T. Taleb, C. Benzaid, <i>Energy and Delay"
        " aware Physical Collision Avoidance in Unmanned Aerial Vehicles</i>, IEEE GLOBECOM 2018"
        ' (<a href="https://doi.org/10.1109/GLOCOM.2018.8647223">doi 10.1109/GLOCOM.2018.8647223</a>), with avoidance'
        " disabled (<b>straight</b>), with the paper's model (<b>paper</b>) and with this project's planner"
        f" (<b>edc</b>). {escape(facts['runs'])} random missions a point: edc flown by the simulator, agents and all,"
        " the other two, which avoid nothing, by their plans alone. Bands are 95 % confidence intervals of the mean"
        " (of collisions a Poisson count's or Student's t, whichever is wider, else Student's)."
        " Execution times are of planning alone:"
        f" wall time, one run after the other, on {escape(facts['machine'])}. Commit"
        f" {escape(facts['commit'] or 'unknown')}. Every run, with the command that flies it again, is a line of"
        ' <a href="runs.jsonl">runs.jsonl</a>.</p>'
    )


def _summary(figures: Sequence[Figure], findings: Mapping[str, FigureFinding]) -> str:
    lines = "".join(
        f'<tr><td><a href="#{figure.name}">{_heading(figure)}</a></td><td>{_verdict(findings[figure.name])}</td></tr>'
        for figure in figures
    )
    return f"<table>{lines}</table>"


def _verdict(finding: FigureFinding) -> str:
    mark = {True: "yes", False: "no", None: ""}[finding.reproduced]
    return f'<b class="{mark}">{finding.verdict}</b>'


def _heading(figure: Figure) -> str:
    number = f"Fig. {figure.name}: " if figure.name[0].isdigit() else ""
    return escape(f"{number}{figure.title}")


def _section(figure: Figure, finding: FigureFinding, rows: Sequence[Row]) -> str:
    name = figure.name
    claim = "The paper says" if finding.from_paper else "Asked"
    found = "".join(f"<li>{escape(sentence)}</li>" for sentence in finding.found)
    return (
        f'<section id="{name}"><h2>{_heading(figure)}</h2><p>{claim}: <q>{escape(finding.claim)}</q>'
        f' {_verdict(finding)}</p><img src="{name}.svg" alt="{escape(figure.title)}"><ul>{found}</ul>'
        f"<details><summary>Numbers</summary>{_numbers(rows)}</details>"
        f"<p>{_files(name)}</p></section>"
    )


def _numbers(rows: Sequence[Row]) -> str:
    head = "".join(
        f"<th>{name}</th>" for name in ("line", rows[0].x_name, "runs", "mean", "95 % from", "to", "largest")
    )
    body = "".join(
        f"<tr><td>{row.series}</td><td>{row.x:g}</td><td>{row.runs}</td><td>{_number(row.mean)}</td>"
        f"<td>{_number(row.ci95_low)}</td><td>{_number(row.ci95_high)}</td><td>{_number(row.largest)}</td></tr>"
        for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _forms(results: Mapping[str, Any], runs: Sequence[Run]) -> str:
    """Return a paragraph on the difference between the two forms of the paper's model, where both were solved."""
    small = [run for run in runs if run.measure == TIME_FORMS and run.mission.uavs <= PRINTED_UAVS]
    apart_m = [results[run.key]["apart_m"] for run in small if results[run.key]["apart_m"] is not None]
    if not apart_m:
        return ""
    return (
        f"<p>Up to {PRINTED_UAVS} UAVs the paper's model is flown as printed in the first runs of each point, beyond"
        f" with its dotted variables eliminated: in {len(apart_m)} missions solved in both forms the paths differ"
        f" by at most {max(apart_m):.1e} m.</p>"
    )


def _long(result: Mapping[str, Any]) -> str:
    heads = result["metrics"]["heads"]
    leaders = len({head["head"] for head in heads})
    ended = "".join(f" {uav['uav']} ran empty in slot {uav['slot']}." for uav in result["exhausted"])
    head = "".join(f"<th>{label}</th>" for label in BILL_COLUMNS.values())
    body = "".join(
        "<tr>" + "".join(f"<td>{_bill_cell(bill[name])}</td>" for name in BILL_COLUMNS) + "</tr>"
        for bill in result["bills"]
    )
    return (
        f'<section id="{LONG}"><h2>Who pays for leading: election by energy in a long mission</h2>'
        f"<p><code>{escape(LONG_RUN.command)}</code>: batteries that begin nearly equal, and a radio that costs 1 J a"
        f" message. {leaders} UAVs led in {len(heads)} terms; each handed over when another battery was more than 0.5 %"
        f" better.{escape(ended) or ' No battery ran empty.'}</p>"
        f'<img src="{LONG}.svg" alt="Batteries and heads over time"><table><tr>{head}</tr>{body}</table>'
        f"<p>{_files(LONG)}</p></section>"
    )


def _bill_cell(value: float | str | None) -> str:
    if value is None:
        return "-"
    return (
        value if isinstance(value, str) else f"{value:.0f}" if value >= 100 or value == int(value) else f"{value:.2f}"
    )
