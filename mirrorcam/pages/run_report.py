"""The page that `mirrorcam run` ends with: one HTML file beside its pictures, which works from disk and offline."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from string import Template

from mirrorcam.console.progress import count_text, figure_text
from mirrorcam.optics.base.values import Metric
from mirrorcam.optics.geometry.layout import Layout

TIMES = "\N{MULTIPLICATION SIGN}"
_UNIT_ENDINGS = ("_deg", "_mm", "_px")
_WORDS = {
    "fov": "field of view",
    "iou": "",
    "rms": "RMS",
    "stl": "STL",
    "p95": "95 % quantile",
}
_LABELS = {
    "normal_error_max_deg": "Direction of the worst mirror, from the truth",
    "normal_error_between_mirrors_max_deg": "Direction of the worst mirror, a turn of all mirrors together aside",
    "distance_error_max_mm": "Distance of the worst mirror, from the truth",
    "held_out_rms_x_px": "Corners in frames left out of the fit, RMS in x",
    "held_out_rms_y_px": "Corners in frames left out of the fit, RMS in y",
    "held_out_spatial_rms_mm": "Corners in frames left out, from their pixel's ray in space, RMS",
    "decoded_corner_rms_px": "Corners in decoded views, from a pinhole at the true place, RMS",
}
_HEADLINES = {
    "normal_error_max_deg": "is how far the worst mirror's calibrated direction is from the truth",
    "decoded_corner_rms_px": "is the RMS distance of decoded corners from where true positions predict them",
}


@dataclass(frozen=True)
class Picture:
    """A picture beside the page: its file, the file that a click opens, its size in px, and what it shows."""

    path: str
    opens: str
    size_px: tuple[int, int]
    alt: str


@dataclass(frozen=True)
class File:
    """A file that the page offers: where it is, and what it is for."""

    path: str
    purpose: str


@dataclass(frozen=True)
class Report:
    """Everything on the page. Paths are relative to it, with forward slashes."""

    command: str
    small: bool
    parabola: Layout
    layout: Layout
    view_size_px: tuple[int, int]
    frames: int
    base_frames: int
    as_built: str
    checks: Mapping[str, Metric]
    truth: Mapping[str, Metric]
    before_after: Picture
    part: Picture
    frame: Picture
    views: Picture
    residuals: Picture
    part_files: tuple[File, ...]
    files: tuple[File, ...]

    @property
    def limited(self) -> dict[str, Metric]:
        """Figures that have a limit, of the part and against the truth."""
        return {name: metric for name, metric in {**self.checks, **self.truth}.items() if metric.limit is not None}

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the figures past their limits."""
        return tuple(name for name, metric in self.limited.items() if not metric.passed)


def label(name: str) -> str:
    """A figure's name as people read it: without its unit, which stands beside the value."""
    if name in _LABELS:
        return _LABELS[name]
    for ending in _UNIT_ENDINGS:
        name = name.removesuffix(ending)
    words = (_WORDS.get(word, re.sub(r"^(\d+)mm$", r"at \1 mm", word)) for word in name.split("_"))
    text = " ".join(word for word in words if word)
    return text[:1].upper() + text[1:]


def value_text(metric: Metric, value: float, digits: int = 4) -> str:
    """A value with its unit; a share as a percentage, and no unit for a plain number."""
    if metric.unit.startswith("of the "):
        return f"{value:.1%}"
    unit = {"1": "", "deg": "°"}.get(metric.unit, f" {metric.unit}")
    return f"{figure_text(value, digits)}{unit}"


def share_of_limit(metric: Metric) -> float:
    """How much of what the limit allows is used: at most 1 when it passes."""
    if metric.limit is None:
        raise ValueError("a figure without a limit uses no share of one")
    part, whole = (metric.value, metric.limit) if metric.lower_is_better else (metric.limit, metric.value)
    return abs(part / whole) if whole else (0.0 if part == whole else float("inf"))


def _value(metric: Metric) -> str:
    return escape(value_text(metric, metric.value))


def limit_text(metric: Metric) -> str:
    """The limit with its unit and its direction."""
    sign = "\N{LESS-THAN OR EQUAL TO}" if metric.lower_is_better else "\N{GREATER-THAN OR EQUAL TO}"
    return "" if metric.limit is None else f"{sign} {value_text(metric, metric.limit)}"


def _verdict(metric: Metric) -> str:
    return '<b class="pass">pass</b>' if metric.passed else '<b class="fail">FAIL</b>'


def _limit_rows(metrics: Mapping[str, Metric]) -> str:
    rows = []
    for name, metric in metrics.items():
        share = share_of_limit(metric)
        width = min(share, 1.0) * 100.0
        state = "pass" if metric.passed else "fail"
        rows.append(
            f'<tr><th scope="row">{escape(label(name))}</th><td>{_value(metric)}</td>'
            f'<td class="limit">{escape(limit_text(metric))}</td>'
            f'<td class="share"><i class="bar {state}" style="--share:{width:.1f}%"></i></td>'
            f"<td>{_verdict(metric)}</td></tr>"
        )
    return "\n".join(rows)


def limit_table(metrics: Mapping[str, Metric]) -> str:
    """Figures against their limits, worst first, and the figures that have none folded away below."""
    limited = {name: metric for name, metric in metrics.items() if metric.limit is not None}
    limited = dict(sorted(limited.items(), key=lambda item: (item[1].passed, -share_of_limit(item[1]))))
    others = {name: metric for name, metric in metrics.items() if metric.limit is None}
    parts = []
    if limited:
        parts.append(
            '<table class="limits"><thead><tr><th scope="col">Figure</th><th scope="col">Measured</th>'
            '<th scope="col" class="limit">Limit</th><th scope="col" class="share">Share of the limit</th>'
            f'<th scope="col"></th></tr></thead><tbody>{_limit_rows(limited)}</tbody></table>'
        )
    if others:
        rows = "".join(
            f'<tr><th scope="row">{escape(label(name))}</th><td>{_value(metric)}</td></tr>'
            for name, metric in others.items()
        )
        parts.append(
            f"<details><summary>{count_text(len(others), 'more figure')}, without a limit</summary>"
            f'<table class="plain"><tbody>{rows}</tbody></table></details>'
        )
    return "\n".join(parts)


def _folded_checks(metrics: Mapping[str, Metric]) -> str:
    """All checks behind one line that says how many pass; unfolded where one fails."""
    limited = [metric for metric in metrics.values() if metric.limit is not None]
    failed = sum(not metric.passed for metric in limited)
    checks = count_text(len(limited), "check")
    line = f"{failed} of {checks} failed" if failed else f"{checks} passed"
    return f"<details{' open' if failed else ''}><summary>{line}</summary>{limit_table(metrics)}</details>"


def _design_table(parabola: Layout, optimised: Layout) -> str:
    rows = []
    for name, metric in optimised.metrics.items():
        before = parabola.metrics.get(name)
        rows.append(
            f'<tr><th scope="row">{escape(label(name))}</th><td>{_value(before) if before else ""}</td>'
            f"<td>{_value(metric)}</td></tr>"
        )
    return (
        '<table class="plain"><thead><tr><th scope="col">Figure</th><th scope="col">Parabola</th>'
        f'<th scope="col">Optimised</th></tr></thead><tbody>{"".join(rows)}</tbody></table>'
    )


def _picture(picture: Picture, caption: str = "") -> str:
    width, height = picture.size_px
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return (
        f'<figure><a href="{escape(picture.opens)}"><img src="{escape(picture.path)}" alt="{escape(picture.alt)}" '
        f'width="{width}" height="{height}" loading="lazy"></a>{below}</figure>'
    )


def _files(files: Iterable[File]) -> str:
    return "".join(
        f'<li><a href="{escape(file.path)}">{escape(file.path)}</a><span>{escape(file.purpose)}</span></li>'
        for file in files
    )


def _highlight(value: str, text: str) -> str:
    return f"<div><dd>{escape(value)}</dd><dt>{escape(text)}</dt></div>"


def _highlights(report: Report) -> str:
    """The few figures that tell a newcomer what came out, of those that were measured."""
    width, height = report.view_size_px
    tiles = [_highlight(f"{report.layout.rows} {TIMES} {report.layout.cols}", f"views of {width} {TIMES} {height} px")]
    for name, metric in report.layout.metrics.items():
        if name.startswith("pixel_efficiency_"):
            before = report.parabola.metrics.get(name)
            versus = f", parabola {before.value:.0%}" if before else ""
            depth = name.removeprefix("pixel_efficiency_").replace("mm", " mm")
            tiles.append(_highlight(f"{metric.value:.0%}", f"of the sensor shows the common scene at {depth}{versus}"))
    for name, text in _HEADLINES.items():
        if name in report.truth:
            tiles.append(_highlight(value_text(report.truth[name], report.truth[name].value, digits=2), text))
    return "".join(tiles)


def number_word(count: int) -> str:
    """Small numbers as words, as in a sentence."""
    words = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
    return words[count] if count < len(words) else str(count)


def index_html(report: Report) -> str:
    """The page. Every text that comes from outside is escaped."""
    failed, count = report.failed, len(report.limited)
    if failed:
        names = ", ".join(label(name) for name in failed)
        verdict, state = f"{len(failed)} of {count} checks failed: {names}", "fail"
    else:
        verdict, state = f"All {count} checks pass", "pass"
    mirrors = number_word(len(report.layout.mirrors))
    camera = report.layout.camera
    return Template(_PAGE).substitute(
        css=CSS,
        mirrors=escape(mirrors),
        kind="A first look" if report.small else "The full run",
        command=escape(report.command),
        verdict=escape(verdict),
        state=state,
        highlights=_highlights(report),
        before_after=_picture(report.before_after),
        design_table=_design_table(report.parabola, report.layout),
        part=_picture(report.part),
        part_checks=_folded_checks(report.checks),
        part_files=_files(report.part_files),
        frame=_picture(report.frame),
        frames=report.frames,
        base_frames=report.base_frames,
        camera=escape(f"{camera.name}, {camera.width_px} {TIMES} {camera.height_px} px"),
        as_built=escape(report.as_built),
        views=_picture(report.views),
        truth=limit_table(report.truth),
        residuals=_picture(report.residuals, "What the calibrated model leaves unexplained over the sensor."),
        files=_files(report.files),
    )


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>MirrorCam: a webcam and $mirrors mirrors</title>
<style>$css</style>
</head>
<body>
<header>
<p class="kicker"><b>MirrorCam</b> <span>$kind</span></p>
<h1>A light field camera made of one webcam and $mirrors flat mirrors.</h1>
<p class="lead">Its mirrors were laid out by an optimiser and turned into printable parts. A copy with the errors of a
real assembly then photographed a board; from those frames alone it was calibrated, checked against the sealed truth,
and its light field decoded.</p>
<p class="verdict $state">$verdict</p>
<dl class="highlights">$highlights</dl>
</header>
<main>
<section>
<h2><span>1</span> The design</h2>
<p>Each mirror shows the scene from its own place, as if a camera stood behind it. A faceted parabola puts these virtual
cameras on a plane, but off a regular grid, and its views share little of the scene. The optimiser moves every mirror
and its four corners until the views overlap.</p>
$before_after
$design_table
</section>
<section>
<h2><span>2</span> The parts</h2>
<p>A holder with a seat for each mirror, a mount, a clip for the camera and a clamp for a robot's wrist, to be printed;
and cutting files for the mirrors. All were read back as exported and compared with the design.</p>
$part
<ul class="files">$part_files</ul>
$part_checks
</section>
<section>
<h2><span>3</span> What the camera sees</h2>
<p>$frames frames of a calibration board by way of the mirrors and $base_frames by the bare camera ($camera).
The mirrors were not where the design put them: $as_built.</p>
$frame
</section>
<section>
<h2><span>4</span> The light field</h2>
<p>The same frame, undistorted, cut and turned upright in one table lookup: one scene from $mirrors places. Grey is what
a mirror does not show.</p>
$views
</section>
<section>
<h2><span>5</span> Against the truth</h2>
<p>The calibration saw the frames, the board and the nominal design. Only afterwards was the truth opened.</p>
$truth
$residuals
</section>
<section>
<h2><span>6</span> Files</h2>
<ul class="files">$files</ul>
</section>
</main>
<footer><p>Made by <code>$command</code></p></footer>
</body>
</html>
"""

CSS = """
:root{color-scheme:light dark;--paper:#fbfaf8;--card:#fff;--ink:#1b1d22;--soft:#5d626d;--line:#e3e0da;
--accent:#0a6a72;--good:#1d7a4a;--bad:#b3261e;--goodwash:#e3f2e9;--badwash:#fbe7e5}
@media (prefers-color-scheme:dark){:root{--paper:#14161a;--card:#1c1f25;--ink:#eceae6;--soft:#a2a7b1;--line:#2f333b;
--accent:#67c5cd;--good:#6fcf97;--bad:#ff8a80;--goodwash:#183325;--badwash:#43201e}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:17px/1.6 system-ui,-apple-system,"Segoe UI",Roboto,
"Helvetica Neue",Arial,sans-serif;-webkit-text-size-adjust:100%}
header,main,footer{max-width:1080px;margin:0 auto;padding:0 24px}
header{padding-top:40px}
.kicker{display:flex;justify-content:space-between;margin:0 0 56px;color:var(--soft);font-size:15px}
.kicker b{color:var(--ink);letter-spacing:.01em}
h1{font-size:clamp(30px,5vw,50px);line-height:1.12;letter-spacing:-.022em;font-weight:680;margin:0 0 20px;
max-width:18em}
.lead{font-size:19px;color:var(--soft);max-width:41em;margin:0 0 28px}
.verdict{display:inline-block;margin:0;padding:7px 16px;border-radius:99px;font-weight:600;font-size:15px}
.verdict.pass{background:var(--goodwash);color:var(--good)}
.verdict.fail{background:var(--badwash);color:var(--bad);border-radius:14px}
.highlights{display:grid;grid-template-columns:repeat(auto-fit,minmax(190px,1fr));gap:1px;margin:36px 0 0;
background:var(--line);border:1px solid var(--line);border-radius:14px;overflow:hidden}
.highlights div{background:var(--card);padding:20px 22px;display:flex;flex-direction:column}
.highlights dd{margin:0;font-size:30px;line-height:1.2;font-weight:640;letter-spacing:-.02em;white-space:nowrap}
.highlights dt{color:var(--soft);font-size:14px;line-height:1.4;margin-top:6px}
section{padding-top:72px}
h2{font-size:26px;line-height:1.2;letter-spacing:-.012em;margin:0 0 10px}
h2 span{color:var(--accent);font-weight:500;margin-right:.35em;font-variant-numeric:tabular-nums}
section>p{max-width:41em;color:var(--soft);margin:0 0 24px}
figure{margin:0 0 24px}
figure a{display:block;background:#fff;border:1px solid var(--line);border-radius:12px;overflow:hidden}
img{display:block;width:100%;height:auto}
table+figure,details+figure{margin-top:32px}
figcaption{color:var(--soft);font-size:14px;margin-top:8px}
a{color:var(--accent);text-underline-offset:3px}
a:focus-visible,summary:focus-visible{outline:2px solid var(--accent);outline-offset:3px;border-radius:4px}
table{width:100%;border-collapse:collapse;font-size:15px;line-height:1.45}
th,td{padding:9px 14px 9px 0;text-align:left;vertical-align:baseline;border-bottom:1px solid var(--line)}
th{font-weight:400}
thead th{color:var(--soft);font-size:13px;border-bottom-color:var(--soft)}
td:last-child,th:last-child{padding-right:0}
td{white-space:nowrap;font-variant-numeric:tabular-nums}
.limits td:last-child{text-align:right}
.limit{color:var(--soft)}
.share{width:26%}
.bar{display:block;height:6px;border-radius:3px;background:var(--line);overflow:hidden;position:relative;top:-3px}
.bar:before{content:"";display:block;height:100%;width:var(--share);min-width:2px;background:var(--good)}
.bar.fail:before{background:var(--bad)}
b.pass{color:var(--good);font-weight:600}
b.fail{color:var(--bad);font-weight:700}
details{margin-top:14px;color:var(--soft);font-size:15px}
summary{cursor:pointer}
details table{margin-top:10px;color:var(--ink)}
.files{list-style:none;margin:0;padding:0;font-size:15px}
.files li{display:flex;flex-wrap:wrap;gap:2px 18px;justify-content:space-between;padding:9px 0;
border-bottom:1px solid var(--line)}
.files a{overflow-wrap:anywhere}
.files span{color:var(--soft)}
footer{padding-top:56px;padding-bottom:64px;color:var(--soft);font-size:14px}
code{font:.94em ui-monospace,SFMono-Regular,Menlo,Consolas,monospace}
@media (max-width:720px){body{font-size:16px}header{padding-top:24px}.kicker{margin-bottom:36px}
section{padding-top:52px}
.lead{font-size:17px}.share{display:none}
.highlights{grid-template-columns:1fr 1fr}.highlights div:last-child:nth-child(odd){grid-column:1/-1}
.highlights dd{font-size:24px}.highlights div{padding:16px}
th,td{padding-right:10px}.plain td{white-space:normal}header,main,footer{padding-left:18px;padding-right:18px}}
"""
