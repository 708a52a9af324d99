"""`report.html` of a calibration: one file, which works from disk and offline, with the verdict on top."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

import numpy as np

from mirrorcam.console.progress import count_text, figure_text
from mirrorcam.optics.base.files import write_text
from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, mirror_sigmas
from mirrorcam.optics.calibration.diagnostics.diagnostics import Diagnostics
from mirrorcam.optics.calibration.diagnostics.model_comparison import SUPPORTED_CHANCE, ModelComparison
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.geometry.camera import INTRINSIC_NAMES
from mirrorcam.pages.calibration.drawings import (
    board_distances,
    board_turns,
    coverage_map,
    depth_sigmas,
    projection_sigmas,
    residual_histogram,
    residual_needles,
)
from mirrorcam.pages.calibration.inline_svg import SIGMA
from mirrorcam.pages.calibration.verdict import STATES, Verdict, check_solution, sigma_px
from mirrorcam.pages.calibration.view_statistics import ViewFigures, board_normals, view_figures
from mirrorcam.pages.run_report import CSS, TIMES, limit_table

STATE_CLASSES = {"good": "pass", "look": "care", "stop": "fail"}
UNITS = {"fx_px": "px", "fy_px": "px", "cx_px": "px", "cy_px": "px"}


def write_report(calibration: Calibration, path: Path, *, command: str = "mirrorcam calibrate") -> None:
    """Write the report of a calibration as one HTML file; `command` is what made it."""
    write_text(path, report_html(calibration, command=command))


def report_html(calibration: Calibration, *, command: str) -> str:
    """The page. The same calibration makes the same page, and every text that comes from outside is escaped."""
    views = view_figures(calibration)
    verdict = check_solution(calibration, views)
    sigma = sigma_px(calibration)
    layout, diagnostics = calibration.layout, calibration.diagnostics
    parts = [
        ("Figures with limits", _checks(calibration, verdict), ""),
        ("What the model leaves", _residuals(calibration, views, sigma), RESIDUALS),
        ("What the pictures show", _pictures(calibration, views), PICTURES),
        ("How sure the mirrors are", _mirrors(calibration), MIRRORS),
    ]
    if diagnostics is not None:
        parts += [
            ("How sure every view is", _projection(calibration, diagnostics, views), PROJECTION),
            ("How sure depth is", _depth(diagnostics), DEPTH),
            ("Which model the pictures support", _model(diagnostics), MODEL),
        ]
    parts.append(("Not found or not used", _notes(calibration), ""))
    camera = layout.camera
    return Template(PAGE).substitute(
        css=CSS + STYLE,
        state=STATE_CLASSES[verdict.state],
        verdict=escape(STATES[verdict.state]),
        reasons=_list(verdict.reasons, "reasons"),
        advice=_advice(verdict, diagnostics),
        highlights=_highlights(calibration),
        identity=escape(layout.identity),
        camera=escape(f"{camera.name}, {camera.width_px} {TIMES} {camera.height_px} px"),
        mirrors=count_text(len(layout.mirrors), "mirror"),
        sections="".join(_section(number, *part) for number, part in enumerate(parts, start=1)),
        command=escape(command),
    )


def _section(number: int, title: str, body: str, lead: str) -> str:
    words = f"<p>{lead}</p>" if lead else ""
    return f"<section><h2><span>{number}</span> {escape(title)}</h2>{words}{body}</section>"


def _card(drawn: str, caption: str = "", *, half: bool = False) -> str:
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f'<figure class="{"half" if half else "whole"}"><div class="card">{drawn}</div>{below}</figure>'


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], style: str = "plain") -> str:
    """A table whose first column names the rows; cells are HTML already."""
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in heads)
    body = "".join(
        f'<tr><th scope="row">{row[0]}</th>{"".join(f"<td>{cell}</td>" for cell in row[1:])}</tr>' for row in rows
    )
    return f'<div class="wide"><table class="{style}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _list(items: Sequence[str], style: str) -> str:
    if not items:
        return ""
    return f'<ul class="{style}">{"".join(f"<li>{escape(_sentence(item))}</li>" for item in items)}</ul>'


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:] + ("" if words.endswith((".", "!", "?")) else ".")


def _highlights(calibration: Calibration) -> str:
    """The few figures that tell what came out."""
    metrics, diagnostics = calibration.metrics, calibration.diagnostics
    tiles = []

    def tile(value: str, words: str) -> None:
        tiles.append(f"<div><dd>{escape(value)}</dd><dt>{escape(words)}</dt></div>")

    if "held_out_rms_x_px" in metrics:
        worse = max(metrics[f"held_out_rms_{axis}_px"].value for axis in "xy")
        tile(f"{figure_text(worse, 3)} px", "per axis is what frames left out of the fit are off, RMS")
    elif "rms_x_px" in metrics:
        worse = max(metrics[f"rms_{axis}_px"].value for axis in "xy")
        tile(f"{figure_text(worse, 3)} px", "per axis is what fitted corners are off, RMS")
    if diagnostics is not None:
        tile(diagnostics.level.replace("+", " + "), "is the model that the pictures support")
        normal = float(np.max(diagnostics.mirrors.normal_deg))
        tile(f"{figure_text(normal, 2)}°", f"is {SIGMA} of the least sure mirror's direction")
        depth = float(np.interp(diagnostics.range_mm, diagnostics.depth.range_mm, diagnostics.depth.total_mm))
        if np.isfinite(depth):
            tile(f"{figure_text(depth, 2)} mm", f"is {SIGMA} of depth at {diagnostics.range_mm:.0f} mm")
    return "".join(tiles)


def _advice(verdict: Verdict, diagnostics: Diagnostics | None) -> str:
    items = list(verdict.advice)
    if diagnostics is not None and diagnostics.weak:
        items.append(f"What these pictures tell least: {diagnostics.weak[0].words}")
    title = "What to do next" if verdict.advice else "Where it is least sure"
    return f"<h3>{title}</h3>{_list(items, 'advice')}" if items else ""


def _checks(calibration: Calibration, verdict: Verdict) -> str:
    """Figures with limits, ours and the caller's, and the others folded away."""
    figures = {check.label: check.metric for check in verdict.checks}
    others = {name: metric for name, metric in calibration.metrics.items() if not name.startswith("mirror_")}
    return limit_table({**figures, **others})


def _residuals(calibration: Calibration, views: Sequence[ViewFigures], sigma: float) -> str:
    mirrors = [view for view in views if view.view != DIRECT]
    direct = [view for view in views if view.view == DIRECT]
    parts = [
        _card(
            residual_needles(calibration, mirrors, sigma),
            "Mean residuals where corners were seen, predicted less detected. Red: more than noise leaves; of noise "
            "alone, 1 % are red.",
        )
    ]
    beside = _card(
        residual_histogram(calibration, sigma),
        "All residuals but the outliers; the scale of counts grows by tens.",
        half=True,
    )
    if direct:
        beside += _card(residual_needles(calibration, direct, sigma), "The same of the direct view.", half=True)
    parts.append(f'<div class="pair">{beside}</div>')
    rows = [
        [
            escape(view.name),
            str(view.frames),
            f"{view.corners:,}",
            str(view.outliers),
            *(f"{value:.4f}" if np.isfinite(value) else "none" for value in view.rms_px),
        ]
        for view in views
    ]
    parts.append(_table(["View", "Frames", "Corners", "Outliers", "RMS x px", "RMS y px"], rows, "plain figures"))
    return "".join(parts)


def _pictures(calibration: Calibration, views: Sequence[ViewFigures]) -> str:
    turned = "How the boards were turned, a dot for each frame"
    if not board_normals(calibration)[1].all():
        turned += ": filled, before the mirrors; open, before the bare camera"
    return (
        _card(coverage_map(calibration.layout, views), "Corners by place, and the part of every view that they fill.")
        + '<div class="pair">'
        + _card(board_distances(views), "Distance of the board, a dot for each frame.", half=True)
        + _card(board_turns(calibration), f"{turned}.", half=True)
        + "</div>"
    )


def _mirrors(calibration: Calibration) -> str:
    layout, diagnostics = calibration.layout, calibration.diagnostics
    parts = []
    if diagnostics is not None:
        known = diagnostics.mirrors
        rows = [
            [
                f"mirror {number}",
                f"{mirror.distance_mm:.3f}",
                figure_text(float(known.distance_mm[number]), 2),
                figure_text(float(known.normal_deg[number]), 2),
                figure_text(float(known.relative_distance_mm[number]), 2),
                figure_text(float(known.relative_normal_deg[number]), 2),
            ]
            for number, mirror in enumerate(layout.mirrors)
        ]
        heads = ["Mirror", "Distance mm", f"{SIGMA} mm", f"{SIGMA} of direction °"]
        heads += [f"{SIGMA} against the others mm", f"{SIGMA} against the others °"]
        parts.append(_table(heads, rows, "plain figures"))
        together = [
            ["turn, °", *(figure_text(float(value), 2) for value in known.common_turn_deg)],
            ["shift, mm", *(figure_text(float(value), 2) for value in known.common_shift_mm)],
        ]
        parts.append(f"<h3>All mirrors together, {SIGMA} about and along the rig's axes</h3>")
        parts.append(_table(["", "x, image right", "y, image down", "z, optical axis"], together, "plain figures"))
        if diagnostics.weak:
            parts.append("<h3>What the pictures tell least</h3>")
            weak = [
                [
                    escape(_sentence(direction.words)),
                    escape("; ".join(_amount(*sigma) for sigma in direction.sigmas)),
                ]
                for direction in diagnostics.weak
            ]
            parts.append(_table(["Direction", f"One {SIGMA} of it"], weak, "plain words"))
    else:
        rows = [
            [
                f"mirror {number}",
                f"{mirror.distance_mm:.3f}",
                figure_text(distance, 2),
                figure_text(np.degrees(tilt), 2),
            ]
            for number, (mirror, (tilt, distance)) in enumerate(zip(layout.mirrors, mirror_sigmas(layout), strict=True))
        ]
        heads = ["Mirror", "Distance mm", f"{SIGMA} mm", f"{SIGMA} of direction °"]
        parts.append(_table(heads, rows, "plain figures"))
    parts.append("<h3>The camera</h3>")
    parts.append(_table(["Number", "Value", SIGMA], _camera_rows(calibration), "plain figures"))
    return "".join(parts)


def _amount(name: str, value: float, unit: str) -> str:
    return f"{name} {figure_text(value, 2)}{'°' if unit == 'deg' else f' {unit}'}".rstrip()


def _camera_rows(calibration: Calibration) -> list[list[str]]:
    known = calibration.layout.uncertainty
    sigmas: dict[str, float] = {}
    if known is not None:
        sigmas = dict(zip(known.parameters, np.sqrt(np.diag(known.covariance)).tolist(), strict=True))
    rows = []
    for name, value in zip(INTRINSIC_NAMES, calibration.layout.camera.intrinsics, strict=True):
        unit = UNITS.get(name, "")
        sigma = figure_text(sigmas[name], 2) if name in sigmas else "held"
        rows.append([f"{name.removesuffix('_px')} {unit}".strip(), f"{value:.3f}" if unit else f"{value:.6f}", sigma])
    return rows


def _projection(calibration: Calibration, diagnostics: Diagnostics, views: Sequence[ViewFigures]) -> str:
    maps = [one for one in diagnostics.projection if one.view != DIRECT]
    reference = "the direct view" if diagnostics.reference == DIRECT else f"mirror {diagnostics.reference}"
    in_rig: list[FloatArray] = [one.in_rig_px for one in maps]
    against: list[FloatArray] = [one.against_reference_px for one in maps]
    cards = ""
    for name, values, words in (
        ("rig", in_rig, "of a point held before the camera"),
        ("reference", against, f"of a point held where {reference} shows it, which is what depth rests on"),
    ):
        most = float(np.max(np.concatenate(values)))
        cards += _card(
            projection_sigmas(calibration.layout, views, maps, values, most, name=f"sigma-{name}"),
            f"{SIGMA} px {words}, {diagnostics.range_mm:.0f} mm away: medians; the strongest colour is {most:.2g} px.",
            half=True,
        )
    return f'<div class="pair">{cards}</div>'


def _depth(diagnostics: Diagnostics) -> str:
    if np.isfinite(diagnostics.depth.total_mm).sum() < 2:
        return "<p>Nowhere do two views show a point amid the reference view: this layout tells no depth there.</p>"
    return _card(depth_sigmas(diagnostics.depth, diagnostics.range_mm))


def _model(diagnostics: Diagnostics) -> str:
    rows = []
    for comparison in diagnostics.comparisons:
        first = comparison.against is None
        rows.append(
            [
                f"<b>{escape(comparison.name)}</b>"
                if comparison.name == diagnostics.level
                else escape(comparison.name),
                str(comparison.parameters),
                f"{comparison.rms_px:.4f}",
                "" if first else escape(comparison.against or ""),
                "" if first else figure_text(comparison.drop, 3),
                "" if first else _chance(comparison.chance),
                "" if first else _held_out(comparison),
                f"{comparison.held_out_gain:.1f} {SIGMA}" if np.isfinite(comparison.held_out_gain) else "",
                _taken(comparison, diagnostics.level),
            ]
        )
    heads = ["Model", "Numbers", "RMS px", "Against", f"Drop, {SIGMA}²", "By chance", "Held out px", "Better by", ""]
    parts = [_table(heads, rows, "plain figures")]
    if diagnostics.free_views is not None:
        free = diagnostics.free_views
        parts.append(
            f"<p>The check: with a free virtual camera for each mirror, {free.parameters} numbers more, "
            f"{figure_text(free.unexplained_px, 2)} px per axis would be explained that mirrors leave "
            f"(so much by chance: {_chance(free.chance)}).</p>"
        )
    if diagnostics.splits:
        rows = [
            [
                escape(split.how),
                f"{split.frames[0]} and {split.frames[1]}",
                f"{np.max(split.difference_px):.3g}",
                f"{np.max(split.predicted_px):.3g}",
                f"{split.overall_ratio:.2f}",
                _chance(split.overall_chance),
            ]
            for split in diagnostics.splits
        ]
        parts.append("<h3>Two halves of the frames, each calibrated alone</h3>")
        heads = ["Halves", "Frames", "Most they differ px", "Most predicted px", "Ratio over all", "By chance"]
        parts.append(_table(heads, rows, "plain figures"))
    parts.append(_list(diagnostics.alarms, "reasons"))
    return "".join(parts)


def _held_out(comparison: ModelComparison) -> str:
    if np.isfinite(comparison.held_out_rms_px):
        return figure_text(comparison.held_out_rms_px, 4)
    return "open" if comparison.chance < SUPPORTED_CHANCE and comparison.information_gain > 0.0 else "not needed"


def _taken(comparison: ModelComparison, level: str) -> str:
    if comparison.name == level:
        return '<b class="pass">taken</b>'
    if comparison.name == "paper" or level.startswith(f"{comparison.name}+"):
        return "on the way"
    return '<b class="fail">supported</b>' if comparison.supported else "no"


def _chance(value: float) -> str:
    return "&lt; 0.001" if value < 1e-3 else f"{value:.3f}"


def _notes(calibration: Calibration) -> str:
    notes = [*calibration.notes, *(calibration.diagnostics.notes if calibration.diagnostics else ())]
    return _list(notes, "notes") or "<p>Nothing: every picture showed the board in every view.</p>"


RESIDUALS = """Where the fit is right, needles are short and point anywhere. Needles that agree with their neighbours
tell of something that the model does not know."""
PICTURES = """Corners all over every view pin down lens and mirrors; boards at several distances and tilts tell focal
length, mirror distance and the board's own pose apart."""
MIRRORS = """All planes share the errors of the camera, so that each alone is less sure than the planes against each
other, which is what the light field's geometry rests on."""
PROJECTION = """One standard deviation of where a point appears, along its worst direction, from the covariance of
camera and mirrors, with the board's poses free."""
DEPTH = """Of a point where the reference view saw the boards, triangulated from all views that show it. What matching
leaves shrinks with better matching; what calibration leaves does not."""
MODEL = """Each addition has to explain more than noise would and predict frames that it has not seen. What is not
supported is not used."""

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Calibration $identity</title>
<style>$css</style>
</head>
<body>
<header>
<p class="kicker"><b>MirrorCam</b> <span>Calibration $identity</span></p>
<h1 class="$state">$verdict</h1>
<p class="lead">$mirrors, $camera.</p>
$reasons
$advice
<dl class="highlights">$highlights</dl>
</header>
<main>
$sections
</main>
<footer><p>Made by <code>$command</code></p></footer>
</body>
</html>
"""

STYLE = """
:root{--care:#8a5a00;--second:#a04f9a}
@media (prefers-color-scheme:dark){:root{--care:#f0bf5e;--second:#d79ad2}}
h1.pass{color:var(--good)}h1.care{color:var(--care)}h1.fail{color:var(--bad)}
h3{font-size:17px;margin:32px 0 6px}
header ul{max-width:46em;margin:0 0 12px;padding-left:1.2em}
ul.reasons,ul.advice,ul.notes{padding-left:1.2em;max-width:52em}
.notes{color:var(--soft);font-size:15px}
.card{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:16px}
.pair{display:grid;grid-template-columns:1fr 1fr;gap:0 24px;align-items:start}
.pair>.half:last-child:nth-child(odd){grid-column:1}
svg{display:block;overflow:visible;width:100%;height:auto;margin:0 auto;
font:13px/1 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
svg text{fill:var(--ink)}svg .tick,svg .name{fill:var(--soft);font-variant-numeric:tabular-nums}
svg .on{paint-order:stroke;stroke:var(--card);stroke-width:4px}
svg .tag{font-size:12px;font-weight:600;paint-order:stroke;stroke:var(--card);stroke-width:5px}
svg .outline{fill:none;stroke:var(--soft);stroke-width:1}
svg .grid,svg .ring{stroke:var(--line);fill:none}svg .axis{stroke:var(--soft)}
svg .needle{fill:var(--accent)}svg .needle.bad{fill:var(--bad)}
svg .ruler{stroke:var(--ink);stroke-width:2}
svg .steps{fill:none;stroke:var(--accent);stroke-width:1.6}svg .steps.y{stroke:var(--second)}
svg .normal{fill:none;stroke:var(--ink);stroke-width:1.6;stroke-dasharray:5 4}
svg .cell,svg .shade{fill:var(--accent);shape-rendering:crispEdges}
svg .cell.none{fill:var(--bad);fill-opacity:.16;stroke:var(--bad);stroke-opacity:.4}
svg .dot{fill:var(--accent);fill-opacity:.75}svg .dot.faint{fill-opacity:.4}
svg .dot.open{fill:none;stroke:var(--accent);stroke-width:1.6}
svg .curve{fill:none;stroke:var(--ink);stroke-width:2}svg .curve.matching{stroke:var(--accent)}
svg .curve.calibration{stroke:var(--second)}svg .here{stroke:var(--soft);stroke-dasharray:3 4}
.wide{overflow-x:auto;margin:8px 0 0}
.figures td{text-align:right}.figures tbody th{white-space:nowrap}.figures thead th:not(:first-child){text-align:right}
.words td,.words th{white-space:normal;vertical-align:top}
section>p{margin-top:14px}
@media (max-width:820px){.pair{grid-template-columns:1fr}}
"""
