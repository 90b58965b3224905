"""The page of a data set of motions: shares, causes, histograms, the worst motions with still pictures, and a table of all."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from rbd.errors import InputError, PictureError
from rbd.installation import VERSION
from rbd.model.output_files import write_text
from rbd.motion.causes import FIGURES
from rbd.motion.contact_detection import NOTHING
from rbd.visual.playback.report_motion import cause_colors
from rbd.visual.stills import still

MOST_PAGES = 12
"""Motions, the worst first, that get a picture and a page of their own."""
BINS = 12
_HISTOGRAMS = (
    ("score", "score", "score", 1.0, 100.0), ("balance", "frames that balance", "%", 100.0, 100.0),
    ("motors", "frames within the motors", "%", 100.0, 100.0),
    ("tilt_rad", "tilt of soles, median", "degrees", 180.0 / np.pi, None),
    ("hover_m", "hover of feet, median", "mm", 1e3, None), ("slip_m_s", "slip of feet, median", "mm/s", 1e3, None),
)  # fmt: skip
_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
body { margin: 0 auto; max-width: 1180px; padding: 20px 24px 60px; color: #1f2933; background: #ffffff; }
body, table { font: 14px/20px system-ui, "DejaVu Sans", sans-serif; }
h1 { font-size: 24px; line-height: 30px; margin: 8px 0 4px; } h2 { font-size: 17px; margin: 34px 0 10px; }
p { margin: 4px 0; } .quiet { color: #52606d; } a { color: #0b5d94; }
.row { display: flex; flex-wrap: wrap; gap: 14px; }
.tile { flex: 1 1 120px; background: #eef2f5; border-radius: 6px; padding: 10px 14px; }
.tile b { display: block; font-size: 24px; line-height: 32px; }
.bars { display: grid; grid-template-columns: max-content 1fr max-content; gap: 4px 10px; align-items: center; }
.bar { height: 13px; border-radius: 2px; min-width: 1px; } .right { text-align: right; }
figure { margin: 0; flex: 0 1 170px; } figure svg { display: block; width: 100%; height: auto; }
figcaption { font-size: 13px; line-height: 17px; overflow-wrap: anywhere; }
.worst { display: grid; grid-template-columns: repeat(auto-fill, minmax(170px, 1fr)); gap: 16px; }
.worst figure { width: auto; border: 1px solid #d9e2ec; border-radius: 6px; padding: 8px; }
.worst img { display: block; width: 100%; aspect-ratio: 1; object-fit: contain; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; width: 100%; }
th, td { padding: 4px 8px; text-align: right; white-space: nowrap; border-bottom: 1px solid #e4e9ee; }
th { position: sticky; top: 0; background: #ffffff; cursor: pointer; }
th:first-child, td:first-child, .left { text-align: left; }
td:first-child, .left { overflow-wrap: anywhere; white-space: normal; min-width: 150px; }
</style>
</head>
<body>
<h1>$title</h1>
<p class="quiet">$about</p>
$body
<script>
for (const head of document.querySelectorAll("th")) head.addEventListener("click", () => {
  const body = head.closest("table").tBodies[0], i = head.cellIndex, up = head.dataset.up = head.dataset.up === "1" ? "" : "1";
  const value = (row) => row.cells[i].dataset.value ?? row.cells[i].textContent;
  const by = (a, b) => isNaN(value(a) - value(b)) ? value(a).localeCompare(value(b)) : value(a) - value(b);
  body.append(...[...body.rows].sort((a, b) => up ? by(a, b) : by(b, a)));
});
</script>
</body>
</html>
""")


def export_motion_checks(checks: Any, folder: str | os.PathLike[str], *, pages: int = MOST_PAGES, **settings: Any) -> Path:
    """Write the page of a data set, `index.html` in a folder, beside pages of its worst motions; returns its path.

    It has the shares of frames that are possible and without a fault of balance, feet and motors; how many have which cause;
    histograms over the motions; the worst motions at their worst frames; a table of all. It needs no network, and no
    browser to be made.

    Args:
        checks: `MotionChecks`, of `rbd.studies.check_motions`.
        folder: Is made where it is not there.
        pages: How many motions, the worst first, get a picture, and a page that plays them; they are checked again for it.
        settings: Of `rbd.visual.export_motion`, for these pages.

    Raises:
        InputError: no motion was checked.
        PictureError: the folder cannot be made, or written into.
    """
    if not checks.ranked:
        raise InputError("no motion was checked, so that there is nothing to show; the error of each file is in `failed`.")
    place = Path(os.path.expanduser(folder))
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PictureError(f"the folder {str(place)!r:.300} cannot be made: {error.strerror}.") from None
    worst, links = list[str](), dict[str, str]()
    for file, numbers in checks.ranked[::-1][:pages]:
        report, name = checks.report(file), _free(Path(file).stem, links.values())
        links[file] = report.export(place / name, **settings).name
        worst.append(_card(file, numbers, links[file], still(
            report.motion.robot, np.array(numbers["worst"]["q"]), ground=numbers["ground_m"], push=numbers["worst"]["missing"]
        )))  # fmt: skip
    robots = ", ".join(sorted({x["robot"] for _, x in checks.ranked}))
    title = f"{len(checks.ranked)} motions of {robots}"
    s = checks.ranked[0][1]["settings"]
    about = (
        f"{checks.frames:,} frames, {checks.duration_s / 60.0:.1f} min. Friction {s['friction']:g}, {100 * s['threshold']:g} % "
        f"of the weight may be missing, feet are meant to touch up to {1e3 * s['touch_height']:g} mm. rbd {VERSION}."
    )
    parts = [_tiles(checks), _causes(checks), _histograms([x for _, x in checks.ranked])]
    if worst:
        parts.append(f"<h2>The worst motions, at their worst frames</h2><div class='worst'>{''.join(worst)}</div>")
    notes = {file: " ".join(told) for file, x in checks.ranked if (told := [n for n in x["notes"] if n.startswith(NOTHING)])}
    failed = {file: message for file, (_, message) in checks.failed.items()}
    parts += [_all(checks, links), _told("Without contacts for long", notes), _told("Not checked", failed)]
    path = place / "index.html"
    write_text(path, _PAGE.substitute(title=html.escape(title), about=html.escape(about), body="\n".join(parts)))
    return path


def _free(stem: str, taken: Iterable[str]) -> str:
    """A name for a page that no other one has."""
    names, name, count = {*taken, "index.html"}, f"{stem}.html", 1
    while name in names:
        count += 1
        name = f"{stem}_{count}.html"
    return name


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def _tiles(checks: Any) -> str:
    scores = [x["score"] for _, x in checks.ranked]
    rows = [
        ("possible", _percent(checks.possible), "of the frames, without any cause"),
        *((name, _percent(x), "of the frames without a fault") for name, x in checks.figures.items()),
        ("score", f"{np.median(scores):.0f}", f"median; {min(scores):.0f} to {max(scores):.0f} of 100"),
    ]
    tiles = (f"<div class='tile'>{name}<b>{value}</b><span class='quiet'>{words}</span></div>" for name, value, words in rows)
    return f"<div class='row' style='margin-top:16px'>{''.join(tiles)}</div>"


def _causes(checks: Any) -> str:
    colors, n = cause_colors(), len(checks.ranked)
    motions = {cause: sum(cause in x["causes"] for _, x in checks.ranked) for cause in checks.causes}
    rows = [(c, x, colors[c], f"{_percent(x)}, {motions[c]} of {n} motions") for c, x in checks.causes.items()]
    weights = np.array([x["frames"] for _, x in checks.ranked], float)
    heights = checks.ranked[0][1]["possible_at_mm"]
    at = {h: float(np.average([x["possible_at_mm"][h] for _, x in checks.ranked], weights=weights)) for h in heights}
    more = [(f"{h} mm", share, "#8fa3b5", _percent(share)) for h, share in at.items()]
    return (
        f"<div class='row' style='gap:40px'><div style='flex:2 1 480px'><h2>Causes, share of the frames</h2>{_bars(rows)}</div>"
        f"<div style='flex:1 1 300px'><h2>Possible if points up to a height touched</h2>{_bars(more)}</div></div>"
    )


def _bars(rows: Sequence[tuple[str, float, str, str]]) -> str:
    each = (
        f"<span>{name}</span><div class='bar' style='width:{100.0 * share:.2f}%;background:{color}'></div>"
        f"<span class='right quiet'>{words}</span>"
        for name, share, color, words in rows
    )
    return f"<div class='bars'>{''.join(each)}</div>"


def _histograms(numbers: Sequence[Mapping[str, Any]]) -> str:
    figures = (
        _histogram(title, unit, factor * np.array([x[name] for x in numbers]), top)
        for name, title, unit, factor, top in _HISTOGRAMS
    )
    return f"<h2>Over the motions</h2><div class='row'>{''.join(figures)}</div>"


def _histogram(title: str, unit: str, values: np.ndarray, top: float | None) -> str:
    """How many motions have which value: bars, with the ends of the axis and the median."""
    most = top or max(float(np.ceil(values.max(initial=0.0))), 1.0)
    counts, _ = np.histogram(values.clip(0.0, most), bins=BINS, range=(0.0, most))
    wide, high = 180.0 / BINS, 80.0 / max(counts.max(), 1)
    bars = "".join(
        f"<rect x='{i * wide + 1:.1f}' y='{90 - c * high:.1f}' width='{wide - 2:.1f}' height='{c * high:.1f}' fill='#0072b2'>"
        f"<title>{c} motions from {i * most / BINS:.3g} to {(i + 1) * most / BINS:.3g} {unit}</title></rect>"
        for i, c in enumerate(counts.tolist()) if c
    )  # fmt: skip
    median = round(float(np.median(values)), 6)
    x = 180.0 * min(median / most, 1.0)
    text = "<text y='106' font-size='11' fill='#52606d'"
    return (
        f"<figure><svg viewBox='-4 0 188 110' role='img' aria-label='{title}'>{bars}<path d='M0 90H180' stroke='#9aa5b1'/>"
        f"<path d='M{x:.1f} 4V90' stroke='#d55e00' stroke-dasharray='3 2'/>{text} x='0'>0</text>"
        f"{text} x='180' text-anchor='end'>{most:g}</text></svg>"
        f"<figcaption>{title}: {median:.3g} {unit if unit != 'score' else ''} in the median</figcaption></figure>"
    )


def _card(file: str, x: Mapping[str, Any], page: str, picture: bytes) -> str:
    worst, data = x["worst"], base64.b64encode(picture).decode()
    told = ", ".join(worst["causes"]) or "possible"
    return (
        f"<figure><a href='{html.escape(page)}'><img src='data:image/png;base64,{data}' alt='{html.escape(x['robot'])}'></a>"
        f"<figcaption><a href='{html.escape(page)}'>{html.escape(Path(file).name)}</a><br>score {x['score']:.0f}<br>"
        f"<span class='quiet'>{worst['t_s']:.2f} s: {told}</span></figcaption></figure>"
    )


def _all(checks: Any, links: Mapping[str, str]) -> str:
    heads = ("motion", "s", "score", *FIGURES, "possible", "tilt, deg", "hover, mm", "slip, mm/s", "missing, %", "causes")
    rows = []
    for file, x in checks.ranked:
        name = html.escape(checks.names[file])
        shown = f"<a href='{html.escape(links[file])}'>{name}</a>" if file in links else name
        shares = [100.0 * x[each] for each in (*FIGURES, "possible")]
        sizes = np.rad2deg(x["tilt_rad"]), 1e3 * x["hover_m"], 1e3 * x["slip_m_s"], 100.0 * x["missing_median"]
        cells = [f"{x['duration_s']:.1f}", f"{x['score']:.1f}", *(f"{v:.0f}" for v in shares), *(f"{v:.1f}" for v in sizes)]
        causes = sorted(x["causes"].items(), key=lambda each: -each[1])[:3]
        told = ", ".join(f"{cause} {100.0 * count / x['frames']:.0f} %" for cause, count in causes)
        rows.append(f"<tr><td>{shown}</td>{''.join(f'<td>{cell}</td>' for cell in cells)}<td class='left'>{told}</td></tr>")
    head = "".join(f"<th{' class=left' * (name == 'causes')}>{name}</th>" for name in heads)
    return (
        "<h2>All motions, best first</h2><p class='quiet'>balance, feet, motors: % of the frames without a fault of theirs; "
        "possible: without any. A click on a heading sorts.</p>"
        f"<div class='scroll'><table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def _told(title: str, words: Mapping[str, str]) -> str:
    """What is told of some files, as a table; empty without any."""
    rows = (f"<tr><td>{html.escape(f)}</td><td class='left'>{html.escape(text)}</td></tr>" for f, text in words.items())
    body = "".join(rows)
    return f"<h2>{title}</h2><table><tbody>{body}</tbody></table>" if body else ""
