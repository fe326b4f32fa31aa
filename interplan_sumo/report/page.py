"""Page: the report as one self-contained HTML file: no script, no external request, everything escaped."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from interplan_sumo.batch.run_folder import Row
from interplan_sumo.report.formats import columns, figure, notes
from interplan_sumo.report.published import published_figure, published_rows
from interplan_sumo.report.table import COLUMNS, Cell, Line, Table
from interplan_sumo.report.why import lost_points

_STYLE = """
:root { color-scheme: light dark; --ink: #1d2733; --soft: #5d6b7a; --line: #d9dee5; --paper: #ffffff; --tint: #f4f6f9;
  --good: #2f8f5b; --fair: #d79a1e; --poor: #c8463c; --accent: #2f5fa8; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e9ef; --soft: #9aa7b5; --line: #36414d; --paper: #161c23;
  --tint: #1f2731; --good: #4bb27b; --fair: #e0ae45; --poor: #e0675d; --accent: #7fa8e6; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 80rem; padding: 2rem 1.25rem 4rem; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif; }
h1 { font-size: 1.7rem; margin: 0 0 .25rem; letter-spacing: -.01em; }
h2 { font-size: 1.15rem; margin: 2.5rem 0 .75rem; }
p { margin: .25rem 0; } .soft, .note { color: var(--soft); } .note { font-size: .9rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: .4rem .6rem; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { font-size: .8rem; font-weight: 600; color: var(--soft); white-space: nowrap; }
tbody th { font-size: 1em; color: var(--ink); white-space: normal; overflow-wrap: anywhere; min-width: 9rem; }
td.n, th.n { text-align: right; white-space: nowrap; } td.total { font-weight: 700; }
tbody tr:hover { background: var(--tint); } tr.paper td { color: var(--soft); }
.warn { border-left: 4px solid var(--poor); background: var(--tint); padding: .6rem .9rem; margin: 1rem 0; }
.bar { display: inline-block; width: 5.5rem; height: .55rem; border-radius: .3rem; background: var(--line);
  vertical-align: middle; margin-right: .5rem; overflow: hidden; }
.bar > i { display: block; height: 100%; border-radius: .3rem; }
.good { background: var(--good); } .fair { background: var(--fair); } .poor { background: var(--poor); }
.bars { display: grid; grid-template-columns: repeat(auto-fit, minmax(21rem, 1fr)); gap: 1rem; }
.card { border: 1px solid var(--line); border-radius: .5rem; padding: .75rem 1rem; }
.card h3 { margin: 0 0 .5rem; font-size: .95rem; overflow-wrap: anywhere; }
.card div { display: flex; align-items: center; justify-content: space-between; gap: .75rem; font-size: .88rem; }
.card .bar { flex: 1; margin: 0; }
.card span:first-child { width: 4.5rem; }
.card span:last-child { width: 7.5rem; text-align: right; white-space: nowrap; }
details { border: 1px solid var(--line); border-radius: .5rem; margin: .75rem 0; padding: 0 1rem; }
summary { cursor: pointer; padding: .7rem 0; font-weight: 600; overflow-wrap: anywhere; }
summary:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
ul { margin: 0; padding-left: 1.1rem; } li { overflow-wrap: anywhere; }
.fault { color: var(--poor); font-weight: 600; } code { font-size: .85em; overflow-wrap: anywhere; }
"""


def page(table: Table, *, title: str = "interplan-sumo report", paper: bool = False) -> str:
    """The whole report as HTML. Names, reasons and messages are text whatever they hold."""
    complete = "" if table.complete else f'<p class="warn" role="alert">{escape(_incomplete(table))}</p>'
    said = "".join(f'<p class="note">{escape(note)}</p>' for note in notes(table, paper=paper))
    bars = "".join(_card(line) for line in table.lines)
    drives = "".join(_drives(line) for line in table.lines)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<title>{escape(title)}</title>
<style>{_STYLE}</style>
</head>
<body>
<main>
<h1>{escape(title)}</h1>
<p class="soft">Suite <code>{escape(table.suite)}</code>, profile <code>{escape(table.profile)}</code></p>
{complete}
<h2>Scores</h2>
<div class="scroll">{_scores(table, paper=paper)}</div>
{said}
<h2>By family</h2>
<div class="bars">{bars}</div>
<h2>Every drive</h2>
{drives}
</main>
</body>
</html>
"""


def _scores(table: Table, *, paper: bool) -> str:
    shown = columns(table, paper=paper)
    head = "".join(f'<th class="n" scope="col">{escape(c.title)}</th>' for c in shown)
    body = ""
    for line in table.lines:
        cells = "".join(
            f'<td class="n{" total" if c.key == "interplan" else ""}">{escape(figure(line.cells[c.key]))}</td>'
            for c in shown
        )
        body += f'<tr><th scope="row">{escape(line.label)}</th>{cells}</tr>'
    for row in published_rows() if paper else ():
        cells = "".join(f'<td class="n">{published_figure(row, c.key)}</td>' for c in shown)
        body += f'<tr class="paper"><td>{escape(str(row["planner"]))} (paper)</td>{cells}</tr>'
    return f'<table><thead><tr><th scope="col">planner</th>{head}</tr></thead><tbody>{body}</tbody></table>'


def _incomplete(table: Table) -> str:
    missing = [
        f"{scenario} ({planner}, seed {seed})" for line in table.lines for scenario, planner, seed in line.missing
    ]
    listed = ", ".join(missing[:20]) + (f" and {len(missing) - 20} more" if len(missing) > 20 else "")
    return f"This run is incomplete. No score for: {listed}."


def _card(line: Line) -> str:
    rows = "".join(
        f"<div><span>{escape(c.title)}</span>{_bar(cell)}<span>{escape(figure(cell))}</span></div>"
        for c in COLUMNS
        if (cell := line.cells[c.key]).asked
    )
    return f'<section class="card"><h3>{escape(line.label)}</h3>{rows}</section>'


def _bar(cell: Cell) -> str:
    value = 0.0 if cell.value is None else cell.value
    return f'<span class="bar" aria-hidden="true"><i class="{_colour(value)}" style="width:{value:.1f}%"></i></span>'


def _colour(value: float) -> str:
    return "good" if value >= 80.0 else "fair" if value >= 40.0 else "poor"


def _drives(line: Line) -> str:
    rows = "".join(_drive(row) for row in line.rows)
    head = '<th>scenario</th><th class="n">seed</th><th>score</th><th>goal line</th><th>what cost points</th>'
    count = f"{len(line.rows)} drive{'s' if len(line.rows) != 1 else ''}"
    faults = ", ".join(f"{n} {name} fault{'s' if n > 1 else ''}" for name, n in line.faults.items())
    return (
        f"<details open><summary>{escape(line.label)}: {count}{escape(f', {faults}' if faults else '')}</summary>"
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></details>'
    )


def _drive(row: Row) -> str:
    if row["score"] is None:
        shown = '<span class="fault">none</span>'
    else:
        value = 100.0 * row["score"]
        shown = _bar(Cell(value, None, 1, 1)) + f"{value:.1f}"
    reached = "passed" if row["reached_goal"] else "not passed"
    return (
        f"<tr><td>{escape(row['scenario_id'])}</td><td class='n'>{row['seed']}</td><td>{shown}</td>"
        f"<td>{reached}</td><td>{_reasons(row, lost_points(row))}</td></tr>"
    )


def _reasons(row: Row, reasons: Iterable[str]) -> str:
    mark = " class='fault'" if row["fault"] else ""
    items = "".join(f"<li{mark}>{escape(reason)}</li>" for reason in reasons)
    return f"<ul>{items}</ul>" if items else "nothing"
