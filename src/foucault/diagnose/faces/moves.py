"""Do the gyros speak of the same axes as the accelerometers when the instrument changes faces?

Rests on faces calibrate the accelerometers, and rests say nothing of the axes of gyros or of their
unit. The moves from one face to the next do, whatever way they went.
"""

from __future__ import annotations

import numpy as np

from foucault.diagnose import axes
from foucault.diagnose.faces.rests import Faces
from foucault.errors import error
from foucault.tables import Log


def check_moves(log: Log, faces: Faces) -> None:
    """Refuse gyros whose axes or unit contradict the changes of face.

    `log`: readings [SI]; `faces`: the rests on faces, in the order of the log. Raises
    ``gyro.unit``, ``gyro.axes``, ``gyro.left_handed`` or ``gyro.reversed``; ``faces.moves`` where
    several mistakes would look alike.
    """
    if log.gyro is None or log.averaged is not None or len(faces.first) < 4:
        return
    order = np.argsort(faces.first)
    first, last, up_k = faces.first[order], faces.last[order], faces.readings.up_k[order]
    bias = np.mean([log.gyro[a:b].mean(axis=0) for a, b in zip(first, last, strict=True)], axis=0)
    moves = (up_k, bias, last[:-1] - 1, first[1:])
    declared, best = axes.explain_turns(log, *moves)
    problem = axes.mistake(log, declared, best)
    # Saturated moves are told, and do no harm: the rests calibrate.
    if problem is None or problem.code == "gyro.saturated":
        return
    # From face to face an axis may turn by half turns alone, which do not show its sign.
    every = axes.as_good(log, *moves, best)
    if len(every) == 1:
        raise problem
    raise error(
        "faces.moves", declared=f"{np.degrees(declared.miss):.0f}",
        better=f"{np.degrees(best.miss):.1f}", count=len(every), causes=_causes(log, every),
    )  # fmt: skip


def _causes(log: Log, every: list[axes.Match]) -> str:
    """Return the simplest explanations in words: those that leave most axes as declared."""
    kept = sorted(every, key=lambda m: (m.scale != 1.0, -np.trace(m.exchange)))
    units = sorted(every, key=lambda m: -np.trace(m.exchange))
    chosen = [kept[0]] + [m for m in units[:1] if m is not kept[0]]
    words = [
        axes.exchange_words(m.exchange) + (f", times {m.scale:.4g}" if m.scale != 1.0 else "")
        for m in chosen
    ]
    return " or ".join(words)
