"""The list for whoever does a session: one page to print, and its positions in a picture to turn.

An instrument is drawn as a box, x to its right, y forward, z up, seen from the south and from
above. Every picture stands in the page as it is; a script only turns the large one.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from foucault.arrays import FloatArray
from foucault.files import atomic
from foucault.procedures.stages import Stage, lasting
from foucault.report import COLOURS

_HERE = Path(__file__).parent

AWAY, ABOVE = np.radians(30.0), np.radians(24.0)
"""From where it is seen: so far east of south, and so far above the horizon [rad]."""

HALF = np.array([0.5, 0.78, 0.28])  # Half the box along x, y and z [1].

TIP, NAME, GROUND = 1.08, 1.3, -1.12
"""Where the arrow of an axis ends, where its name stands, and where the ground is [1]."""

RING, AT = 0.26, 0.98  # Radius of the arrow of a turn, and where it is along its axis [1].

FEW, LINES, SOME, MOST = 9, 3, 24, 500
"""Up to so many positions, each of so few lines, a page is printed large; or in the usual size; and
no more of them are drawn [1]."""

SPACE = "\N{NO-BREAK SPACE}"

_A, _E = (np.cos(AWAY), np.sin(AWAY)), (np.cos(ABOVE), np.sin(ABOVE))
VIEW = np.array([
    [_A[0], _A[1], 0.0], [_E[1] * _A[1], -_E[1] * _A[0], -_E[0]],
    [_E[0] * _A[1], -_E[0] * _A[0], _E[1]],
])  # fmt: skip
"""To the right of a picture, down in it, and to whoever looks: rows, East-North-Up [1]."""


def _line(points: FloatArray) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y, *_ in points.tolist())


def picture(C_nb: FloatArray, w_b: FloatArray) -> Markup:
    """Draw an instrument as it stands, and how it turns.

    `C_nb` (3, 3): attitude, instrument to East-North-Up [1]; `w_b` (3,): rate, zero for none
    [rad/s].
    """
    seen = VIEW @ C_nb  # columns: axes of the instrument as they are seen
    circle = np.linspace(0.0, 2 * np.pi, 37)
    rim = np.column_stack([np.cos(circle), np.sin(circle), np.full(37, GROUND)]) @ VIEW.T
    out = [f'<polygon class="ground" points="{_line(rim)}"/>']
    for name, at in (("N", [0.0, 1.2, GROUND]), ("E", [1.2, 0.0, GROUND])):
        x, y, _ = VIEW @ at
        out.append(f'<text class="way" x="{x:.3f}" y="{y:.3f}">{name}</text>')
    near = seen[2] > 0
    out += [_axis(k, seen[:, k]) for k in range(3) if not near[k]]
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for sign in (1.0, -1.0):
            if sign * seen[2, k] <= 0:
                continue
            corners = np.empty((4, 3))
            for n, (a, b) in enumerate(((1, 1), (1, -1), (-1, -1), (-1, 1))):
                corners[n] = seen[:, [k, i, j]] @ (HALF[[k, i, j]] * [sign, a, b])
            kind = f"axis{k + 1}" + ("" if sign > 0 else " back")
            out.append(f'<polygon class="{kind}" points="{_line(corners)}"/>')
    out += [_axis(k, seen[:, k]) for k in range(3) if near[k]]
    if rate := float(np.linalg.norm(w_b)):
        out.append(_turn(C_nb @ w_b / rate))
    out += [_name(k, seen[:, k]) for k in range(3)]
    return Markup("".join(out))


def _axis(k: int, tip: FloatArray) -> str:
    (x, y), (u, v) = (tip[:2] * HALF[k]).tolist(), (tip[:2] * TIP).tolist()
    return f'<line class="axis{k + 1}" x1="{x:.3f}" y1="{y:.3f}" x2="{u:.3f}" y2="{v:.3f}"/>'


def _name(k: int, tip: FloatArray) -> str:
    x, y = (tip[:2] * NAME).tolist()
    return f'<text class="axis{k + 1}" x="{x:.3f}" y="{y:.3f}">{"xyz"[k]}</text>'


def _turn(u: FloatArray) -> str:
    """Draw the arrow of a turn about `u` (3,), East-North-Up [1], where it is seen."""
    p = np.cross(u, np.eye(3)[int(np.abs(u).argmin())])
    p /= np.linalg.norm(p)
    q = np.cross(u, p)
    angle = np.linspace(0.0, 5.2, 27)
    at = AT * u if VIEW[2] @ u >= 0 else -AT * u
    arc = at + RING * (np.outer(np.cos(angle), p) + np.outer(np.sin(angle), q))
    ahead = at + RING * (np.cos(5.75) * p + np.sin(5.75) * q)
    out, end = (at + s * RING * (np.cos(5.2) * p + np.sin(5.2) * q) for s in (1.45, 0.55))
    return (
        f'<polyline class="turns" points="{_line(arc @ VIEW.T)}"/>'
        f'<polygon class="turned" points="{_line(np.array([ahead, out, end]) @ VIEW.T)}"/>'
    )


def page(title: str, line: Sequence[str], stages: Sequence[Stage]) -> str:
    """Return the page of a session; `line`: what is said of it in short."""
    begins = np.cumsum([0.0, *(one.time for one in stages)])
    count, stages = len(stages), stages[:MOST]
    cards = [
        {
            "set": _together(one.set), "acts": [(act.words, lasting(act.time).replace(" ", SPACE))
                                          for act in one.acts],
            "picture": picture(one.shown, one.turns), "move": lasting(one.move) * (one.move > 0),
            "at": f"{int(at + one.move) // 60}:{int(at + one.move) % 60:02d}",
        }
        for one, at in zip(stages, begins.tolist(), strict=False)
    ]  # fmt: skip
    short = len(cards) <= FEW and max(len(one.acts) for one in stages) <= LINES
    many = "few" if short else "some" if len(cards) <= SOME else "many"
    return str(_template().render(
        title=title, line=[*line, f"{count} position{'s' if count != 1 else ''}",
                           f"{lasting(float(begins[-1]))} in all"],
        cards=cards, more=count - len(cards), many=many, motion=_motion(stages),
        css="".join(f.read_text("utf-8") for f in (COLOURS, _HERE / "operator.css")),
        js=(_HERE / "operator.js").read_text("utf-8"),
    ))  # fmt: skip


def _together(text: str) -> str:
    """Let lines break only between the parts of what is set."""
    return ", ".join(one.replace(" ", SPACE) if len(one) < 14 else one for one in text.split(", "))


def save(text: str, path: str | Path) -> None:
    """Write a page, whole or not at all."""
    with atomic(Path(path)) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _motion(stages: Sequence[Stage]) -> dict[str, Any]:
    """Return what the script needs to turn the large picture."""
    return {
        "view": VIEW.round(6).tolist(), "half": HALF.tolist(),
        "at": [TIP, NAME, RING, AT],
        "stages": [
            {
                "set": one.set, "C": one.shown.round(6).tolist(), "w": one.turns.tolist(),
                "acts": [
                    {"words": f"{act.words}, {lasting(act.time)}", "C": act.C_nb.round(6).tolist(),
                     "w": act.w_b.tolist(), "time": act.time}
                    for act in one.acts
                ],
            }
            for one in stages
        ],
    }  # fmt: skip


@cache
def _template() -> Any:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    made = Environment(
        loader=FileSystemLoader(_HERE), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    made.filters["script"] = lambda value: Markup(
        json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    )
    return made.get_template("operator.html")
