"""How the pictures of the gallery look."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl

STYLE = {
    "figure.figsize": (7.0, 4.4),
    "figure.dpi": 110,
    "figure.constrained_layout.use": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.92",
    "font.size": 10,
    "legend.framealpha": 0.9,
    "axes.prop_cycle": mpl.cycler(color=["#1565c0", "#c62828", "#2e7d32", "#8e24aa", "#ef6c00"]),
}


def style(*_: Any) -> None:
    """Set it before each example."""
    mpl.rcParams.update(STYLE)
