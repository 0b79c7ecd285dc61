"""The drawings of a discovery's report, as SVG in the colours of its page."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import TYPE_CHECKING, Any

import numpy as np

from observer.fit.evidence import PROOF, UNUSED, Evidence
from observer.fit.runs import BLOCK_S
from observer.frames import FloatArray
from observer.report.panels import CATEGORIES, FAINT, INK, QUIET, RC, elapsed, scale_limit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEAN_S = BLOCK_S
WIDTH, NARROW = 9.4, 4.9
"""Of a drawing in inches, at 72 units of SVG each; and of the same drawing for a phone."""
LEFT, RIGHT, BETWEEN = 1.05, 0.1, 0.1
LEFT_NARROW = 0.55
COLD, WARM = (0x2B, 0x83, 0xC4), (0xD9, 0x64, 0x1C)
"""Blue below and vermilion above zero, of a lightness that shows on white and on black."""
PAGE, LINE, AFTER, BEFORE = "#fefefe", RC["axes.edgecolor"], CATEGORIES[0], CATEGORIES[1]
FOLLOWS = {
    INK: "currentColor",
    QUIET: "var(--quiet)",
    FAINT: "var(--faint)",
    LINE: "var(--line)",
    PAGE: "var(--page)",
    AFTER: "var(--after)",
    BEFORE: "var(--before)",
}
"""What the page's colours replace."""
SVG_RC = RC | {
    "svg.fonttype": "none",
    "image.composite_image": False,
    "text.parse_math": False,
    "font.size": 9.5,
    "axes.titlesize": 9.5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 9.0,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "legend.fontsize": 9.5,
}
ROLES = {PROOF: "proof", UNUSED: "left out"}


@dataclass(frozen=True, slots=True)
class Track:
    """One log on a regular grid of b half minutes.

    Attributes:
        name: The log's name.
        role: What each half minute was used for, (b,): a fold, `PROOF` or `UNUSED`; NaN without data.
        values: Values (s, b) by name, NaN without a mean.
    """

    name: str
    role: FloatArray
    values: dict[str, FloatArray]

    @property
    def time_s(self) -> FloatArray:
        """The end of each half minute since the start of the log, (b,)."""
        return MEAN_S * np.arange(1.0, len(self.role) + 1)


@dataclass(frozen=True, slots=True)
class Box:
    """A stretch of one sensor's row to point out.

    Attributes:
        run: Number of the log.
        sensor: Number of the sensor.
        from_s: Its begin since the start of the log.
        to_s: Its end.
    """

    run: int
    sensor: int
    from_s: float
    to_s: float


def tracks_of(evidence: Evidence, logs: Sequence[str], rows: dict[str, FloatArray]) -> tuple[Track, ...]:
    """Return rows of the evidence laid out by log, sensor and time.

    Args:
        evidence: n means, each with its log, sensor and time.
        logs: The names of the logs.
        rows: Values (n,) by name.
    """
    sensors = int(evidence.sensor.max()) + 1
    column = np.rint(evidence.time_s / MEAN_S).astype(np.int64) - 1
    tracks = []
    for i, name in enumerate(logs):
        of_log = evidence.run == i
        length = int(column[of_log].max(initial=0)) + 1
        role = np.full(length, np.nan)
        role[column[of_log]] = evidence.fold[of_log]
        values = {key: np.full((sensors, length), np.nan) for key in rows}
        for key, grid in values.items():
            grid[evidence.sensor[of_log], column[of_log]] = rows[key][of_log]
        tracks.append(Track(name, role, values))
    return tuple(tracks)


def residual_maps(
    tracks: Sequence[Track], sensors: Sequence[str], maps: dict[str, str], least_K: float, box: Box | None,
    width: float = WIDTH,
) -> str:  # fmt: skip
    """Return errors as SVG, sensor by time, all logs side by side, one map under another on one scale.

    Args:
        tracks: The logs.
        sensors: Names of the sensors, s.
        maps: Headings by the name of the values to show.
        least_K: The smallest end of the scale.
        box: A stretch to frame; None for none.
        width: Of the drawing in inches.
    """
    row = min(max(1.5 / len(sensors), 0.24), 3.6 / len(sensors))
    tall, head, gap, foot = row * len(sensors), 0.62, 0.34, 0.95
    height = head + len(maps) * (tall + gap) + foot
    limit_K = scale_limit([t.values[key] for t in tracks for key in maps], least_K)
    hours = max(len(t.role) for t in tracks) * MEAN_S > 4 * 3600.0
    with _drawing(height, width) as figure:
        for i, (track, left, wide) in enumerate(_lanes(tracks, width)):
            _head(_axes(figure, left, 0.0, wide, head - 0.02), track, wide, names=len(tracks) < 13)
            for m, (key, heading) in enumerate(maps.items()):
                top = head + gap + m * (tall + gap)
                axes = _axes(figure, left, top, wide, tall)
                _map(axes, track, key, limit_K, 3600.0 if hours else 60.0)
                _rows_named(axes, sensors if i == 0 else [""] * len(sensors), row)
                axes.tick_params(labelbottom=m == len(maps) - 1, length=2)
                axes.locator_params(axis="x", nbins=max(1, min(7, round(wide / 0.55))))
                if i == 0:
                    axes.text(
                        0, 1 + 0.07 / tall, heading, transform=axes.transAxes, va="bottom", weight="bold"
                    )
                if box is not None and box.run == i:
                    _outline(axes, box, 3600.0 if hours else 60.0)
        _scale(figure, height, limit_K, f"time since the start of each log, {'h' if hours else 'min'}")
        return _svg(figure, f"maps{width:.0f}", "Measured less predicted, sensor by time")


def comparisons(
    track: Track, lines: dict[str, str], titles: Sequence[str], first: int, width: float = WIDTH
) -> str:
    """Return measured and predicted temperatures on the proof as SVG, a panel for each sensor.

    Args:
        track: The log that holds the proof.
        lines: Names for the key by the key of the track's values; at most three.
        titles: A title for each panel.
        first: Number of the first sensor shown.
        width: Of the drawing in inches; two columns at full width, else one.
    """
    columns = 2 if width == WIDTH else 1
    panel, head = 1.75, 0.34 if columns == 2 else 0.7
    rows = -(-len(titles) // columns)
    proof = track.role == PROOF
    begin = int(np.argmax(proof))
    t, unit = elapsed(np.concatenate([[0.0], track.time_s]))
    t = t[1:]
    wide = (width - columns * 0.5 - RIGHT) / columns
    with _drawing(head + rows * panel + 0.2, width) as figure:
        for i, title in enumerate(titles):
            left = 0.45 + (i % columns) * (wide + 0.5)
            axes = _axes(figure, left, head + (i // columns) * panel + 0.32, wide, panel - 0.66)
            for key, style in zip(lines, _STYLES, strict=False):
                values = np.where(proof, track.values[key][first + i], np.nan)
                axes.plot(t[begin:], values[begin:], **style)
            axes.set_xlim(t[begin] if begin else 0.0, t[-1])
            axes.set_title(title, pad=4)
            axes.locator_params(axis="y", nbins=4)
            axes.tick_params(labelbottom=i + columns >= len(titles), length=2)
            if i + columns >= len(titles):
                axes.set_xlabel(f"time since the start of the log, {unit}", color=QUIET, fontsize=8.5)
        handles = figure.axes[0].get_lines()
        figure.legend(
            handles, list(lines.values()), loc="upper left", bbox_to_anchor=(0.45 / width, 1.0),
            ncols=3 if columns == 2 else 1, borderaxespad=0,
        )  # fmt: skip
        return _svg(figure, f"proof{first}-{columns}", "Measured and predicted on the proof")


_STYLES: tuple[dict[str, Any], ...] = (
    {"color": INK, "lw": 2.6, "alpha": 0.4},
    {"color": BEFORE, "lw": 1.2, "ls": (0, (4, 2))},
    {"color": AFTER, "lw": 1.3},
)


def coloured(error_K: FloatArray, limit_K: float) -> FloatArray:
    """Return colours (s, b, 4): blue below zero, vermilion above, the page itself at zero and where NaN.

    Args:
        error_K: Values (s, b).
        limit_K: The value of full colour.
    """
    part = np.clip(np.nan_to_num(error_K) / limit_K, -1.0, 1.0)
    colour = np.where(part[..., None] < 0, COLD, WARM) / 255.0
    return np.asarray(np.concatenate([colour, np.abs(part)[..., None]], axis=-1))


def shortened(name: str, most: int) -> str:
    """Return a name of at most `most` characters, its middle replaced by `…`."""
    keep = max(most - 1, 2)
    return name if len(name) <= most else f"{name[: (keep + 1) // 2]}…{name[len(name) - keep // 2 :]}"


def _margin(width: float) -> float:
    """The width of the sensors' names in a drawing, in inches."""
    return LEFT if width == WIDTH else LEFT_NARROW


def _lanes(tracks: Sequence[Track], whole: float) -> list[tuple[Track, float, float]]:
    """Every log with its left edge and its width in inches, in proportion to duration but for short ones."""
    length = np.array([len(t.role) for t in tracks], dtype=float)
    room = whole - _margin(whole) - RIGHT - BETWEEN * (len(tracks) - 1)
    width = np.maximum(length / length.sum(), 0.4 / len(tracks))
    width *= room / width.sum()
    left = _margin(whole) + np.concatenate([[0.0], np.cumsum(width + BETWEEN)[:-1]])
    return list(zip(tracks, left.tolist(), width.tolist(), strict=True))


def _head(axes: Axes, track: Track, width: float, *, names: bool) -> None:
    """The name of a log over a strip that says what each part of it was used for."""
    axes.axis("off")
    axes.set(xlim=(0, len(track.role)), ylim=(0, 1))
    if names:
        axes.text(0, 0.98, shortened(track.name, int(width / 0.085)), va="top", weight="bold")
    used = np.flatnonzero(np.isfinite(track.role))
    kind = np.where(track.role[used] >= 0, 0, track.role[used])
    starts = np.flatnonzero(np.diff(kind, prepend=np.nan) != 0)
    for first, after in zip(starts, np.append(starts[1:], len(kind)), strict=True):
        begin, end = float(used[first]), float(used[after - 1] + 1)
        role = ROLES.get(int(kind[first]), "fitted")
        proof = role == "proof"
        axes.axvspan(begin, end, 0.02, 0.48, fc=INK if proof else FAINT, ec="none")
        if (end - begin) / len(track.role) * width > 0.085 * len(role):
            axes.text(
                (begin + end) / 2, 0.24, role, ha="center", va="center", fontsize=8.5,
                color=PAGE if proof else INK,
            )  # fmt: skip


def _map(axes: Axes, track: Track, key: str, limit_K: float, unit_s: float) -> None:
    error_K = track.values[key]
    sensors, length = error_K.shape
    end = length * MEAN_S / unit_s
    axes.imshow(coloured(error_K, limit_K), extent=(0, end, sensors, 0), aspect="auto", interpolation="none")
    axes.grid(visible=False)
    for s in range(1, sensors):
        axes.axhline(s, color=PAGE, lw=1.5)
    for s, row in enumerate(np.isfinite(error_K)):
        edges = np.flatnonzero(np.diff(np.concatenate([[True], row, [True]]).astype(int)))
        spans = [
            (a * end / length, (b - a) * end / length) for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]
        if spans:
            axes.broken_barh(spans, (s + 0.08, 0.84), fc="none", ec=QUIET, hatch="////", lw=0)


def _rows_named(axes: Axes, names: Sequence[str], row: float) -> None:
    size = min(9.0, 60 * row)
    left = (
        axes.get_position().x0 * axes.figure.bbox_inches.width
        if hasattr(axes.figure, "bbox_inches")
        else LEFT
    )
    shown = [shortened(n, int(left / (0.0092 * size))) for n in names]
    axes.set_yticks(np.arange(len(names)) + 0.5, shown, fontsize=size)
    axes.tick_params(axis="y", length=0)


def _outline(axes: Axes, box: Box, unit_s: float) -> None:
    """A frame around what is pointed out."""
    from matplotlib.patches import Rectangle  # noqa: PLC0415 - slow to import

    start, width = box.from_s / unit_s, (box.to_s - box.from_s) / unit_s
    axes.add_patch(
        Rectangle((start, box.sensor), width, 1, fc="none", ec=INK, lw=1.6, clip_on=False, zorder=5)
    )


def _scale(figure: Figure, height: float, limit_K: float, time: str) -> None:
    """The key of the colours, and the label of the time axis."""
    width = figure.get_figwidth()
    figure.text(_margin(width) / width, 0.62 / height, time, color=QUIET, fontsize=8.5, va="center")
    axes = _axes(
        figure, *((LEFT + 2.3, height - 0.5, 2.6) if width == WIDTH else (1.75, height - 0.4, 1.6)), 0.16
    )
    values = np.linspace(-limit_K, limit_K, 101)[None, :]
    axes.imshow(
        coloured(values, limit_K), extent=(-limit_K, limit_K, 0, 1), aspect="auto", interpolation="none"
    )
    axes.grid(visible=False)
    axes.set_yticks([])
    ticks = limit_K * np.array([-1, -0.5, 0, 0.5, 1])
    axes.set_xticks(ticks, [f"{x:+.3g}".replace("-", "−") if x else "0" for x in ticks])
    axes.tick_params(length=2)
    style: dict[str, Any] = {"va": "center", "transform": axes.transAxes}
    axes.text(-0.03, 0.5, "measured − predicted, K", ha="right", **style)
    axes.text(1.03, 0.5, "hatched: no data", ha="left", color=QUIET, **style)


def _axes(figure: Figure, left: float, top: float, width: float, height: float) -> Axes:
    """Axes by inches from the left and the top."""
    whole = figure.get_figheight()
    wide = figure.get_figwidth()
    return figure.add_axes((left / wide, 1 - (top + height) / whole, width / wide, height / whole))


@contextmanager
def _drawing(height: float, width: float) -> Iterator[Figure]:
    """An empty figure, so many inches high and wide, in the style of a page."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context(SVG_RC), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # names are drawn by the browser's fonts
        yield Figure(figsize=(width, height))


def _svg(figure: Figure, name: str, label: str) -> str:
    """The figure as SVG for the inside of a page: its colours, no outside names, ids of its own."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import

    buffer = StringIO()
    with mpl.rc_context({"svg.hashsalt": name}):
        metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(buffer, format="svg", metadata=metadata)
    drawn = buffer.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    root, inside = drawn.split(">", 1)
    view = re.search(r'viewBox="[^"]*"', root)
    assert view is not None, "matplotlib gives every drawing a view box"
    for ink, follows in FOLLOWS.items():
        inside = inside.replace(f": {ink.lower()}", f": {follows}")
    inside = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", inside)
    return f'<svg role="img" aria-label="{escape(label)}" {view[0]}>{inside}'.strip()
