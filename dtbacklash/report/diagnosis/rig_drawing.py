"""A rig drawn as a chain of elements, with the evidence at each of them and labels at some."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch
from numpy.typing import NDArray

from dtbacklash.physics.element_kinds import GROUND
from dtbacklash.physics.rig import SENSOR_PREFIX, Element, Rig
from dtbacklash.report.components.style import INK, MUTED, WIDTH, new_figure, styled
from dtbacklash.report.diagnosis.words import percents

HEAT = LinearSegmentedColormap.from_list("evidence", ["#ffffff", "#fde3c8", "#f6a55f", "#d55e00"])
PITCH_MAX = 1.05  # inch from element to element
TILE = 0.29  # half the side of a tile, inch
PER_ROW = 12
SENSOR_RISE, SENSOR_RADIUS = 0.62, 0.1
NAME_DROP = 0.42
LABEL_DROP, LABEL_HEIGHT = 1.27, 0.56
LINE_HEIGHT, LETTER_WIDTH = 0.16, 0.086

Line = NDArray[np.float64]


def _lines(*points: list[tuple[float, float]]) -> list[Line]:
    return [np.array(line, dtype=float) for line in points]


def _circle(radius: float, x: float = 0.0, y: float = 0.0) -> list[tuple[float, float]]:
    angle = np.linspace(0, 2 * np.pi, 41)
    return [(x + radius * float(np.cos(a)), y + radius * float(np.sin(a))) for a in angle]


def _zigzag(height: float, y: float) -> list[tuple[float, float]]:
    inner = [(x, y + height * s) for x, s in zip(np.linspace(-0.45, 0.45, 7), (0, 1, -1, 1, -1, 1, 0), strict=True)]
    return [(-0.8, y), *inner, (0.8, y)]


def _teeth() -> list[tuple[float, float]]:
    angle = np.linspace(0, 2 * np.pi, 65)
    radius = np.where((np.arange(65) // 4) % 2 == 0, 0.74, 0.54)
    return [(float(r * np.cos(a)), float(r * np.sin(a))) for r, a in zip(radius, angle, strict=True)]


def _thread() -> list[list[tuple[float, float]]]:
    slants = [[(x - 0.09, -0.3), (x + 0.09, 0.3)] for x in np.linspace(-0.55, 0.55, 6)]
    return [[(-0.8, 0.2), (0.8, 0.2)], [(-0.8, -0.2), (0.8, -0.2)], *slants]


def _box(x: float, y: float, bottom: float) -> list[tuple[float, float]]:
    return [(-x, bottom), (x, bottom), (x, y), (-x, y), (-x, bottom)]


def _wheel(radius: float, x: float, teeth: int = 8) -> list[tuple[float, float]]:
    """A toothed wheel about (x, 0.15)."""
    angle = np.linspace(0, 2 * np.pi, 8 * teeth + 1)
    radii = np.where((np.arange(8 * teeth + 1) // 4) % 2 == 0, radius, 0.75 * radius)
    return [(x + float(r * np.cos(a)), 0.15 + float(r * np.sin(a))) for r, a in zip(radii, angle, strict=True)]


def _coil() -> list[tuple[float, float]]:
    """A torsion spring between two ends."""
    inner = [(float(x), float(0.42 * np.sin(6 * np.pi * (x + 0.5)))) for x in np.linspace(-0.5, 0.5, 97)]
    return [(-0.8, 0.0), *inner, (0.8, 0.0)]


#: kind -> lines in a square from -1 to 1
GLYPHS: dict[str, list[Line]] = {
    "amplifier": _lines([(-0.55, -0.62), (-0.55, 0.62), (0.65, 0), (-0.55, -0.62)]),
    "motor_circuit": _lines(
        _zigzag(0.26, 0.36), [(-0.8, 0.36), (-0.8, -0.4), (-0.34, -0.4)], [(0.34, -0.4), (0.8, -0.4), (0.8, 0.36)],
        _circle(0.34, 0, -0.4),
    ),
    "actuator": _lines([(-0.7, 0), (0.7, 0)], [(0.3, 0.35), (0.7, 0), (0.3, -0.35)]),
    "servo": _lines(_circle(0.5, 0.25), [(-0.85, 0.0), (-0.25, 0.0)], [(-0.5, 0.2), (-0.25, 0.0), (-0.5, -0.2)],
                    [(0.25, 0.0), (0.6, 0.35)], _circle(0.08, 0.25)),
    "linear_servo": _lines(_box(0.4, 0.3, -0.3), [(-0.85, 0), (-0.4, 0)], [(-0.6, 0.15), (-0.4, 0), (-0.6, -0.15)],
                           [(-0.7, -0.5), (0.7, -0.5)], [(0.7, -0.6), (0.7, 0.5)]),
    "rotor": _lines(_circle(0.66), _circle(0.14), [(0.14, 0), (0.66, 0)]),
    "gear": _lines(_teeth(), _circle(0.18)),
    "screw": _lines(*_thread()),
    "mass": _lines(_box(0.55, 0.5, -0.5)),
    "brake": _lines(_box(0.55, 0.5, -0.3), *([(x, -0.55), (x + 0.15, -0.35)] for x in np.linspace(-0.6, 0.45, 7))),
    "positioner": _lines([(-0.7, -0.5), (-0.7, 0.5)], [(-0.7, 0), (0.7, 0)], [(0.4, 0.28), (0.7, 0), (0.4, -0.28)]),
    "coupling": _lines(
        _zigzag(0.26, 0.36), [(-0.8, 0.36), (-0.8, -0.4), (-0.25, -0.4)], [(-0.25, -0.65), (-0.25, -0.15)],
        [(0.25, -0.65), (0.25, -0.15)], [(0.25, -0.4), (0.8, -0.4), (0.8, 0.36)],
    ),
    "carriage": _lines(_box(0.66, 0.42, -0.28), _circle(0.16, -0.36, -0.46), _circle(0.16, 0.36, -0.46)),
    "gearbox": _lines(_wheel(0.3, -0.5, 6), _wheel(0.55, 0.3, 11)),
    "belt": _lines(
        _circle(0.35, -0.45), _circle(0.2, 0.5), [(-0.45, 0.35), (0.5, 0.2)], [(-0.45, -0.35), (0.5, -0.2)],
        _circle(0.06, -0.45),
    ),
    "rack": _lines(
        _wheel(0.42, 0.0), [(-0.8, -0.7), (0.8, -0.7)],
        [(-0.8 + 0.1 * k, -0.38 if k % 2 else -0.55) for k in range(17)],
    ),
    "shaft": _lines(_coil(), [(-0.8, -0.45), (-0.8, 0.45)], [(0.8, -0.45), (0.8, 0.45)]),
    "link": _lines(
        _zigzag(0.26, 0.36), [(-0.8, 0.36), (-0.8, -0.4), (-0.1, -0.4)], [(-0.1, -0.62), (-0.1, -0.18)],
        [(-0.3, -0.68), (0.3, -0.68), (0.3, -0.12), (-0.3, -0.12)], [(0.3, -0.4), (0.8, -0.4), (0.8, 0.36)],
    ),
    "turning_joint": _lines(_circle(0.22), [(-0.8, -0.5), (-0.19, -0.11)], [(0.19, 0.11), (0.8, 0.5)]),
    "sliding_joint": _lines(_box(0.35, 0.25, -0.25), [(-0.8, -0.35), (0.8, -0.35)], [(-0.8, 0.35), (0.8, 0.35)]),
    "joint_drive": _lines([(-0.7, 0), (0.7, 0)], [(0.3, 0.35), (0.7, 0), (0.3, -0.35)], _circle(0.25, -0.2)),
    "model_output": _lines(_circle(0.4), [(0.0, 0.0), (0.25, 0.25)]),
}  # fmt: skip


@dataclass
class _Row:
    """One row of the chain: names from left to right, y of its tiles, labels (place, text) and their lanes."""

    names: list[str]
    labels: list[tuple[str, str]]
    lanes: list[int]
    y: float = 0.0

    @property
    def depth(self) -> float:
        """How far the row reaches below the middle of its tiles."""
        lanes = 1 + max(self.lanes, default=-1)
        return LABEL_DROP - 0.28 + lanes * LABEL_HEIGHT


@styled
def draw_rig(rig: Rig, evidence: dict[str, float], labels: list[tuple[str, str]]) -> Figure:
    """The chain of elements, coloured by the evidence located at each.

    rig: gives elements, their neighbours and the sensors.
    evidence: element or ``sensor_<name>`` -> share, 0 to 1; what is not there stays white.
    labels: (location, text of one or two lines) to be shown below their element; several at one are stacked.
    """
    names = chain(rig)
    rows_needed = -(-len(names) // PER_ROW)
    chunks = [list(chunk) for chunk in np.array_split(np.array(names, dtype=object), rows_needed)]
    host = {SENSOR_PREFIX + s.name: s.of for s in rig.sensors.values()}
    xs = _columns(chunks)
    rows = [_row(chunk, labels, host, xs) for chunk in chunks]
    height = 0.0
    for row in rows:
        row.y = -(height + SENSOR_RISE + 0.38)
        height += SENSOR_RISE + 0.38 + row.depth
    figure = new_figure(height)
    figure.set_layout_engine("none")  # every inch is placed by hand
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set(xlim=(0, WIDTH), ylim=(-height, 0), aspect="equal")
    ax.set_axis_off()
    at = {name: (xs[name], row.y) for row in rows for name in row.names}
    told = percents(evidence)
    _connect(ax, rig, at)
    for name in names:
        _tile(ax, rig.elements[name], at[name], evidence.get(name, 0.0), told.get(name, ""))
    _sensors(ax, rig, at, evidence, told)
    for row in rows:
        _labels(ax, row, host, xs, told)
    return figure


def _columns(chunks: list[list[str]]) -> dict[str, float]:
    """x of every element; each row is centred."""
    xs: dict[str, float] = {}
    pitch = _pitch(max(map(len, chunks)))
    for chunk in chunks:
        start = WIDTH / 2 - pitch * (len(chunk) - 1) / 2
        xs |= {name: start + pitch * i for i, name in enumerate(chunk)}
    return xs


def _pitch(count: int) -> float:
    """Distance of the elements of a row, inch."""
    return min(PITCH_MAX, (WIDTH - 0.1) / count)


def label_width(text: str) -> float:
    """Width of a label's box, inch, by its longest line."""
    return LETTER_WIDTH * max(map(len, text.split("\n"))) + 0.2


def _label_x(x: float, text: str) -> float:
    """x of a label's middle: below its element, as far as the paper reaches."""
    half = label_width(text) / 2 + 0.04
    return float(np.clip(x, half, WIDTH - half))


def chain(rig: Rig) -> list[str]:
    """The elements in the order of a walk from the first one along its neighbours; short branches first."""
    near: dict[str, list[str]] = {name: [] for name in rig.elements}
    for a, b in edges(rig):
        if b != GROUND:
            near[a].append(b)
            near[b].append(a)
    walk: list[str] = []
    waiting = list(reversed(rig.elements))
    while waiting:
        name = waiting.pop()
        if name not in walk:
            walk.append(name)
            waiting += sorted(near[name], key=lambda other: -len(near[other]))
    return walk


def _row(names: list[str], labels: list[tuple[str, str]], host: dict[str, str], xs: dict[str, float]) -> _Row:
    """Put each label of the row into the first lane in which it touches no other."""
    mine = [(place, text) for place, text in labels if host.get(place, place) in names]
    taken: list[list[tuple[float, float]]] = []
    lanes = []
    for place, text in mine:
        x, half = _label_x(xs[host.get(place, place)], text), label_width(text) / 2
        free = (k for k, there in enumerate(taken) if all(abs(x - o) >= half + h for o, h in there))
        lane = next(free, len(taken))
        if lane == len(taken):
            taken.append([])
        taken[lane].append((x, half))
        lanes.append(lane)
    return _Row(names, mine, lanes)


def _longest(at: dict[str, tuple[float, float]]) -> int:
    """How many elements the longest row has."""
    return max(Counter(y for _, y in at.values()).values())


def edges(rig: Rig) -> list[tuple[str, str]]:
    """Pairs of neighbours; one of them may be the ground."""
    pairs = []
    for element in rig.elements.values():
        for target in element.neighbours.values():
            names = target if isinstance(target, list) else [target]
            pairs += [(element.name, name) for name in names]
    return pairs


def _connect(ax: Axes, rig: Rig, at: dict[str, tuple[float, float]]) -> None:
    """Lines between neighbours: straight where they stand side by side, else around the tiles."""
    style: dict[str, Any] = {"color": MUTED, "lw": 2.2, "zorder": 1}
    for a, b in edges(rig):
        if b == GROUND:
            continue
        (xa, ya), (xb, yb) = at[a], at[b]
        if ya == yb and abs(xa - xb) < 1.5 * _pitch(_longest(at)):
            ax.plot([xa, xb], [ya, yb], **style)
        elif ya == yb:
            ax.plot([xa, xa, xb, xb], [ya, ya + 0.44, ya + 0.44, yb], **style)
        else:
            (xa, ya), (xb, yb) = sorted((at[a], at[b]), key=lambda place: -place[1])
            middle = yb + SENSOR_RISE + 0.3
            ax.plot([xa + 0.45, xa + 0.45, xb - 0.45, xb - 0.45], [ya, middle, middle, yb], **style)
            ax.plot([xa, xa + 0.45], [ya, ya], **style)
            ax.plot([xb - 0.45, xb], [yb, yb], **style)


def _stand(ax: Axes, x: float, y: float) -> None:
    """Hatched ground below a tile."""
    bottom = y - TILE
    for left in np.linspace(-0.2, 0.16, 7):
        ax.plot([x + left, x + left + 0.05], [bottom - 0.07, bottom - 0.015], color=INK, lw=0.9, zorder=2)
    ax.plot([x - 0.22, x + 0.22], [bottom - 0.005] * 2, color=INK, lw=2.4, zorder=4)


def _tile(ax: Axes, element: Element, place: tuple[float, float], share: float, percent: str) -> None:
    (x, y), name = place, element.name
    share = float(np.clip(share, 0.0, 1.0))
    box = FancyBboxPatch(
        (x - TILE, y - TILE), 2 * TILE, 2 * TILE, boxstyle="round,pad=0,rounding_size=0.07", fc=HEAT(share), ec=INK,
        lw=1.1, zorder=3,
    )  # fmt: skip
    ax.add_patch(box)
    for line in GLYPHS.get(element.kind, []):
        ax.plot(x + 0.82 * TILE * line[:, 0], y + 0.82 * TILE * line[:, 1], color=INK, lw=1.3, zorder=4)
    if element.kind not in GLYPHS:
        ax.text(x, y, element.kind[:4], ha="center", va="center", fontsize=9, zorder=4)
    if GROUND in element.neighbours.get("between", []) or "ground_stiffness" in element.values:
        _stand(ax, x, y)
    ax.text(x, y - NAME_DROP, _broken(name), ha="center", va="top", fontsize=9.5, linespacing=1.05)
    if percent:
        drop = _text_end(name, "") + 0.04
        ax.text(x, y - drop, percent, ha="center", va="top", fontsize=9.5, fontweight="bold",
                color="#a84600")  # fmt: skip


def _text_end(name: str, percent: str) -> float:
    """How far the words below a tile reach, inch."""
    lines = 1 + _broken(name).count("\n")
    return NAME_DROP + LINE_HEIGHT * lines + (0.04 + LINE_HEIGHT if percent else 0.0)


def _broken(name: str) -> str:
    """A long name in two lines."""
    if len(name) <= 10 or "_" not in name:
        return name
    cut = min((i for i, sign in enumerate(name) if sign == "_"), key=lambda i: abs(i - len(name) / 2))
    return name[: cut + 1] + "\n" + name[cut + 1 :]


def _sensors(
    ax: Axes, rig: Rig, at: dict[str, tuple[float, float]], evidence: dict[str, float], told: dict[str, str]
) -> None:
    """A dial above the element that each sensor watches."""
    for element in rig.elements:
        watching = [s for s in rig.sensors.values() if s.of == element]
        for k, sensor in enumerate(watching):
            x = at[element][0] + 0.5 * (k - (len(watching) - 1) / 2)
            y = at[element][1] + SENSOR_RISE
            share = evidence.get(SENSOR_PREFIX + sensor.name, 0.0)
            ax.plot([at[element][0], x], [at[element][1] + TILE, y - SENSOR_RADIUS], color=MUTED, lw=1.0, ls=":")
            fill = HEAT(float(np.clip(share, 0, 1)))
            ax.add_patch(Circle((x, y), SENSOR_RADIUS, fc=fill, ec=INK, lw=1.0, zorder=3))
            ax.plot([x, x + 0.055], [y - 0.02, y + 0.055], color=INK, lw=1.1, zorder=4)
            percent = told.get(SENSOR_PREFIX + sensor.name, "")
            text = sensor.name + (f"  {percent}" if percent else "")
            ax.text(x, y + 0.14, text, ha="center", va="bottom", fontsize=9.5,
                    fontweight="bold" if percent else "normal")  # fmt: skip


def _labels(ax: Axes, row: _Row, host: dict[str, str], xs: dict[str, float], told: dict[str, str]) -> None:
    for (place, text), lane in zip(row.labels, row.lanes, strict=True):
        element = host.get(place, place)
        x = xs[element]
        y = row.y - LABEL_DROP - lane * LABEL_HEIGHT
        ax.text(
            _label_x(x, text), y, text, ha="center", va="center", fontsize=10, color=INK, linespacing=1.25, zorder=6,
            bbox={"boxstyle": "round,pad=0.32", "fc": "#fff6ec", "ec": "#d55e00", "lw": 1.2},
        )  # fmt: skip
        top = row.y - _text_end(element, told.get(element, "")) - 0.05
        ax.plot([x, x], [top, y], color="#d55e00", lw=1.2, zorder=2)
