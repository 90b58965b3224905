"""The page of a data set of motions: shares, causes, histograms, the worst motions with still pictures, and a table of all."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError, PictureError
from rbd.installation import VERSION
from rbd.model.output_files import write_text
from rbd.motion.causes import FIGURES
from rbd.motion.contact_detection import NOTHING
from rbd.visual.pages.page import ONLY_ITSELF, page_template, system_colors
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
_COLUMNS = (
    ("score", 1.0, 1), *((name, 100.0, 0) for name in (*FIGURES, "possible")), ("tilt_rad", 180.0 / np.pi, 1),
    ("hover_m", 1e3, 1), ("slip_m_s", 1e3, 1), ("missing_median", 100.0, 1),
)  # fmt: skip
"""Of the table of all: number, its factor, decimals."""
NO_BREAK = "\u00a0"
"""Between a number and its unit."""
GREY = "#b8c2cc"
"""What was before."""
TOLD = (NOTHING, "its own rate was kept")
"""Notes that are listed begin so."""
_PAGE = page_template(
    system_colors()
    + """body { margin: 0 auto; max-width: 1180px; padding: 20px 24px 60px; color: var(--ink); background: var(--halo); }
body, table { font: 14px/20px system-ui, "DejaVu Sans", sans-serif; }
h1 { font-size: 24px; line-height: 30px; margin: 8px 0 4px; } h2 { font-size: 17px; margin: 34px 0 10px; }
p { margin: 4px 0; } .quiet { color: var(--soft); } a { color: var(--link); }
.row { display: flex; flex-wrap: wrap; gap: 14px; }
.tile { flex: 1 1 120px; background: var(--pressed); border-radius: 6px; padding: 10px 14px; }
.tile b { display: block; font-size: 24px; line-height: 32px; }
.bars { display: grid; grid-template-columns: max-content minmax(60px, 1fr) auto; gap: 4px 10px; align-items: center; }
.bar { height: 13px; border-radius: 2px; min-width: 1px; } .right { text-align: right; }
figure { margin: 0; flex: 0 1 170px; } figure svg { display: block; width: 100%; height: auto; }
figcaption { margin-top: 4px; font-size: 13px; line-height: 17px; overflow-wrap: anywhere; }
.worst { display: grid; grid-template-columns: repeat(auto-fill, minmax(170px, 1fr)); gap: 16px; }
.worst figure { width: auto; min-width: 0; border: 1px solid var(--edge); border-radius: 6px; padding: 8px; }
.worst figure { overflow-wrap: anywhere; }
.worst.wide { grid-template-columns: repeat(auto-fill, minmax(min(340px, 100%), 1fr)); }
.stills { display: flex; gap: 10px; margin-top: 6px; font-size: 13px; line-height: 17px; }
.stills div { flex: 1; min-width: 0; }
.was { color: var(--soft); font-weight: normal; font-size: 0.8em; }
.worst img { display: block; width: 100%; aspect-ratio: 1; object-fit: contain; }
.scroll { overflow-x: auto; background:
  linear-gradient(90deg, var(--halo) 60%, transparent) 0 0 / 48px 100% local,
  linear-gradient(270deg, var(--halo) 60%, transparent) 100% 0 / 48px 100% local,
  linear-gradient(90deg, var(--faint), transparent) 0 0 / 18px 100%,
  linear-gradient(270deg, var(--faint), transparent) 100% 0 / 18px 100%; background-repeat: no-repeat; }
table { border-collapse: collapse; width: 100%; }
th, td { padding: 4px 8px; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--line); }
th { cursor: pointer; }
th:first-child, td:first-child, .left { text-align: left; }
td:first-child, .left { overflow-wrap: anywhere; white-space: normal; min-width: 150px; }""",
    """<h1>$title</h1>
<p class="quiet">$about</p>
$body
<script>
for (const head of document.querySelectorAll("th")) head.addEventListener("click", () => {
  const body = head.closest("table").tBodies[0], i = head.cellIndex, up = head.dataset.up = head.dataset.up === "1" ? "" : "1";
  const value = (row) => row.cells[i].dataset.value ?? row.cells[i].textContent;
  const by = (a, b) => isNaN(value(a) - value(b)) ? value(a).localeCompare(value(b)) : value(a) - value(b);
  body.append(...[...body.rows].sort((a, b) => up ? by(a, b) : by(b, a)));
});
</script>""",
    policy=ONLY_ITSELF + "; img-src data:",
)


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
        level = report.lanes.ground
        stills = [
            still(
                report.motion.robot,
                np.array(x["worst"]["q"]),
                ground=level if isinstance(level, Terrain) else x["ground_m"],
                push=x["worst"]["missing"],
            )
            for x in _both(numbers)
        ]
        worst.append(_card(file, numbers, links[file], stills))
    robots = ", ".join(sorted({x["robot"] for _, x in checks.ranked}))
    title = f"{len(checks.ranked)} motions of {robots}"
    s, x = checks.ranked[0][1]["settings"], checks.together
    about = (
        f"{x['frames']:,}{NO_BREAK}frames, {x['duration_s'] / 60.0:.1f}{NO_BREAK}min. Friction{NO_BREAK}{s['friction']:g}, "
        f"{_percent(s['threshold'], 'g')} of the weight may be missing, feet are meant to touch up to "
        f"{1e3 * s['touch_height']:g}{NO_BREAK}mm. rbd{NO_BREAK}{VERSION}."
    )
    if "before" in x:
        about += " Grey: before the motions were changed."
    numbers = [each for _, each in checks.ranked]
    parts = [_tiles(x, numbers), _causes(x, numbers), _histograms(numbers)]
    if worst:
        wide = " wide" * ("before" in x)
        parts.append(f"<h2>The worst motions, at their worst frames</h2><div class='worst{wide}'>{''.join(worst)}</div>")
    notes = {file: " ".join(told) for file, x in checks.ranked if (told := [n for n in x["notes"] if n.startswith(TOLD)])}
    failed = {file: message for file, (_, message) in checks.failed.items()}
    parts += [_all(checks, links), _told("To be looked at", notes), _told("Not checked", failed)]
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


def _both(x: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The numbers before a motion was changed, if it was, and its own."""
    return [*([x["before"]] if "before" in x else []), x]


def _beside(texts: Iterable[str]) -> str:
    """What was, in grey, and what is."""
    *was, now = texts
    return "".join(f"<span class='was'>{each}{NO_BREAK}&rarr;</span> " for each in was) + now


def _percent(share: float, digits: str = ".1f") -> str:
    return f"{100.0 * share:{digits}}{NO_BREAK}%"


def _tiles(whole: Mapping[str, Any], numbers: Sequence[Mapping[str, Any]]) -> str:
    scores = [[each["score"] for each in some] for some in zip(*map(_both, numbers), strict=True)]
    rows = [
        (name, _beside(_percent(x[name]) for x in _both(whole)), f"of the frames without {fault}")
        for name, fault in (("possible", "any cause"), *((name, "a fault") for name in FIGURES))
    ]
    told = f"median; {min(scores[-1]):.0f} to {max(scores[-1]):.0f} of 100"
    rows.append(("score", _beside(f"{np.median(some):.0f}" for some in scores), told))
    tiles = (f"<div class='tile'>{name}<b>{value}</b><span class='quiet'>{words}</span></div>" for name, value, words in rows)
    return f"<div class='row' style='margin-top:16px'>{''.join(tiles)}</div>"


def _causes(whole: Mapping[str, Any], numbers: Sequence[Mapping[str, Any]]) -> str:
    colors, n, both = cause_colors(), len(numbers), [x["causes"] for x in _both(whole)]
    named = sorted({cause for causes in both for cause in causes}, key=lambda cause: -both[0].get(cause, 0.0))
    rows = []
    for cause in named:
        shares, motions = [causes.get(cause, 0.0) for causes in both], sum(cause in x["causes"] for x in numbers)
        of = f"{motions} of {n} motions".replace(" ", NO_BREAK)
        rows.append((cause, shares, colors[cause], f"{_beside(map(_percent, shares))}, {of}"))
    weights, more = np.array([x["frames"] for x in numbers], float), []
    for h in numbers[0]["possible_at_mm"]:
        each = np.array([[x["possible_at_mm"][h] for x in _both(motion)] for motion in numbers])
        at = np.average(each, axis=0, weights=weights).tolist()
        more.append((f"{h}{NO_BREAK}mm", at, "#0072b2", _beside(map(_percent, at))))
    return (
        f"<div class='row' style='gap:40px'><div style='flex:2 1 480px'><h2>Causes, share of the frames</h2>{_bars(rows)}</div>"
        f"<div style='flex:1 1 300px'><h2>Possible if points up to a height touched</h2>{_bars(more)}</div></div>"
    )


def _bars(rows: Sequence[tuple[str, Sequence[float], str, str]]) -> str:
    """A bar for each share, those before in grey above it."""
    out = []
    for name, shares, color, words in rows:
        bars = "".join(
            f"<div class='bar' style='width:{100.0 * share:.2f}%;height:{13 // (len(shares) - i)}px;background:{fill}'></div>"
            for i, (share, fill) in enumerate(zip(shares, [GREY, color][-len(shares) :], strict=True))
        )
        out.append(f"<span>{name}</span><div>{bars}</div><span class='right quiet'>{words}</span>")
    return f"<div class='bars'>{''.join(out)}</div>"


def _histograms(numbers: Sequence[Mapping[str, Any]]) -> str:
    figures = (
        _histogram(title, unit, factor * np.array([[x[name] for x in _both(motion)] for motion in numbers]), top)
        for name, title, unit, factor, top in _HISTOGRAMS
    )
    return f"<h2>Over the motions</h2><div class='row'>{''.join(figures)}</div>"


def _histogram(title: str, unit: str, values: np.ndarray, top: float | None) -> str:
    """How many motions have which value, shape (motions, 1), or (motions, 2) with that before, in grey; and the median."""
    most = top or max(float(np.ceil(values.max(initial=0.0))), 1.0)
    counts = [np.histogram(x.clip(0.0, most), bins=BINS, range=(0.0, most))[0] for x in values.T]
    wide, high = 180.0 / BINS, 80.0 / max(np.max(counts), 1)
    bars = "".join(
        f"<rect x='{i * wide + 1 + 3 * k:.1f}' y='{90 - c * high:.1f}' width='{wide - 2 - 6 * k:.1f}' height='{c * high:.1f}' "
        f"fill='{fill}'><title>{c} motions from {i * most / BINS:.3g} to {(i + 1) * most / BINS:.3g} {unit}</title></rect>"
        for k, (some, fill) in enumerate(zip(counts, [GREY, "#0072b2"][-len(counts) :], strict=True))
        for i, c in enumerate(some.tolist()) if c
    )  # fmt: skip
    medians = np.median(values, axis=0).round(6).tolist()
    x, words = 180.0 * min(medians[-1] / most, 1.0), _beside(f"{each:.3g}" for each in medians)
    text = "<text y='106' font-size='11' style='fill:var(--soft)'"
    return (
        f"<figure><svg viewBox='-4 0 188 110' role='img' aria-label='{title}'>{bars}<path d='M0 90H180' stroke='#9aa5b1'/>"
        f"<path d='M{x:.1f} 4V90' stroke='#d55e00' stroke-dasharray='3 2'/>{text} x='0'>0</text>"
        f"{text} x='180' text-anchor='end'>{most:g}</text></svg>"
        f"<figcaption>{title}: {words}{NO_BREAK + unit if unit != 'score' else ''} in the median</figcaption></figure>"
    )


def _card(file: str, x: Mapping[str, Any], page: str, stills: Sequence[bytes]) -> str:
    """A motion at its worst frame, beside what it was there; what a repair says of its longest time that is not possible."""
    alt, parts = html.escape(x["robot"]), []
    for each, picture in zip(_both(x), stills, strict=True):
        told, data = ", ".join(each["worst"]["causes"]) or "possible", base64.b64encode(picture).decode()
        words = f"{each['worst']['t_s']:.2f}{NO_BREAK}s, {_percent(each['possible'], '.0f')} possible: {told}"
        parts.append(f"<div><img src='data:image/png;base64,{data}' alt='{alt}'><span class='quiet'>{words}</span></div>")
    why = next((note for note in x["notes"] if note.startswith("not possible from")), "")
    score = _beside(f"{each['score']:.0f}" for each in _both(x))
    return (
        f"<figure><a href='{html.escape(page)}'>{html.escape(Path(file).name)}</a>, score{NO_BREAK}{score}"
        f"<div class='stills'>{''.join(parts)}</div><figcaption class='quiet'>{html.escape(why)}</figcaption></figure>"
    )


def _all(checks: Any, links: Mapping[str, str]) -> str:
    heads = ("motion", "s", "score", *FIGURES, "possible", "tilt, deg", "hover, mm", "slip, mm/s", "missing, %", "causes")
    rows = []
    for file, x in checks.ranked:
        name = html.escape(checks.names[file])
        shown = f"<a href='{html.escape(links[file])}'>{name}</a>" if file in links else name
        cells = [(f"{x['duration_s']:.1f}", x["duration_s"])]
        for each, factor, digits in _COLUMNS:
            cells.append((_beside(f"{factor * some[each]:.{digits}f}" for some in _both(x)), x[each]))
        causes = sorted(x["causes"].items(), key=lambda each: -each[1])[:3]
        told = ", ".join(f"{cause}{NO_BREAK}{_percent(count / x['frames'], '.0f')}" for cause, count in causes)
        row = "".join(f"<td data-value='{value:.6g}'>{cell}</td>" for cell, value in cells)
        rows.append(f"<tr><td>{shown}</td>{row}<td class='left'>{told}</td></tr>")
    head = "".join(f"<th{' class=left' * (name == 'causes')}>{name}</th>" for name in heads)
    return (
        "<h2>All motions, best first</h2><p class='quiet'>balance, feet, motors: % of the frames without a fault of theirs; "
        "possible: without any. A click on a heading sorts.</p>"
        f"<div class='scroll' tabindex='0'><table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def _told(title: str, words: Mapping[str, str]) -> str:
    """What is told of some files, as a table; empty without any."""
    rows = (f"<tr><td>{html.escape(f)}</td><td class='left'>{html.escape(text)}</td></tr>" for f, text in words.items())
    body = "".join(rows)
    return f"<h2>{title}</h2><table><tbody>{body}</tbody></table>" if body else ""
