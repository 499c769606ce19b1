"""North seeking: which root, what an unknown latitude costs, and the method's own figures.

The instrument and the bound are those of `north_seeking_bound`.
"""

from __future__ import annotations

import numpy as np
from north_seeking_bound import (
    RATE_SD,
    STOP_SD,
    UP_SD,
    G,
    all_around,
    bound,
    drawn,
    heading_errors,
    likelihood,
    numbers,
    pair,
    pairs_of,
    regular,
    right_root,
)

from foucault.estimate.north import Known, closed_form, solve
from foucault.models.earth import EARTH_RATE

PRINTED_WRONG = {-30: 100, 0: 50, 10: 25, 20: 0}
"""Per cent of headings for which the printed root is wrong, tilt 10/10: the method's."""


def root_rows(draws: int, rng) -> tuple[list[str], bool]:
    """Wrong roots of the printed rule and of ours, and what is flagged."""
    lines = []
    good = True
    for tilt in ((0, 0), (10, 10)):
        for degrees in (-75, -30, -10, 0, 5, 10, 20, 30):
            x = all_around(tilt, degrees, 360, 0.5)
            exact = numbers(x)
            plus = closed_form(exact[:, :2], exact[:, 2:] / G, latitude=None, rate_sd=RATE_SD,
                               up_sd=UP_SD)[0]  # fmt: skip
            wrong_latitude = np.abs(plus[:, 3] - x[:, 3]) > 1e-6
            printed = 100 * np.mean((np.abs(heading_errors(plus, x)) > 1e-6) | wrong_latitude)
            y = np.repeat(x, draws, axis=0)
            pairs = pairs_of(drawn(y, rng))
            side = "north" if degrees >= 0 else "south"
            cells = []
            place = np.radians(degrees)
            for known in (Known(G, hemisphere=side), Known(G, place, np.radians(5.0)),
                          Known(G, place)):  # fmt: skip
                found = solve(pairs, known)
                wrong = np.abs(heading_errors(found.angles, y)) > 5 * found.sd[:, 0]
                quiet = wrong & ~found.ambiguous
                cells += [wrong.mean(), found.ambiguous.mean(), quiet.mean()]
                # A five-sigma event that is not flagged is a false answer.
                good &= bool(quiet.mean() < 1e-3)
            method = PRINTED_WRONG.get(degrees) if tilt != (0, 0) else None
            if method is not None:
                good &= abs(printed - method) < 1.0
            lines.append(
                f"| {pair(tilt)} | {degrees} | {printed:.1f} % | "
                f"{'' if method is None else f'{method} %'} | "
                f"{' | '.join(f'{100 * c:.2f} %' for c in cells[:7])} |"
            )
    return lines, good


def sizes() -> tuple[list[str], bool]:
    """The method's own figures beside ours, from covariances."""
    lines = []
    good = True
    for degrees, printed in ((30, 0.0311), (80, 0.155), (85, 0.309), (89, 1.54)):
        x = all_around((0, 0), degrees)
        sd = np.degrees(np.sqrt(bound(x, 0.0)[:, 0, 0].mean()))
        formula = np.degrees(STOP_SD / (np.sqrt(2) * EARTH_RATE * np.cos(np.radians(degrees))))
        lines.append(f"| {degrees} | {sd:.4f} | {formula:.4f} | {printed} |")
        good &= abs(sd / printed - 1) < 5e-3
    return lines, good


def large_tilt(draws: int, rng) -> list[str]:
    """RMS of heading at the method's two steep cases, twelve headings."""
    lines = []
    for tilt, printed in (((60, 60), (0.084, 0.114, 0.134)), ((89, 0), (0.18, 1.81, 0.28))):
        x = all_around(tilt, 45, 12)
        usual = regular(x, bound(x, np.inf))
        for label, some in (("all 12 headings", x), (f"the {usual.sum()} regular", x[usual])):
            y = np.repeat(some, 20 * draws, axis=0)
            values = drawn(y, rng)
            rate, up = values[:, :2], values[:, 2:] / G
            errors = [heading_errors(likelihood(values, y, y[0, 3], "known").angles, y)]
            words = {"rate_sd": RATE_SD, "up_sd": UP_SD}
            errors.append(heading_errors(closed_form(rate, up, latitude=y[0, 3], **words)[0], y))
            both = [
                heading_errors(closed_form(rate, up, latitude=None, hemisphere=side, **words)[0], y)
                for side in ("north", "south")
            ]
            errors.append(np.where(np.abs(both[0]) < np.abs(both[1]), both[0], both[1]))
            rms = [np.degrees(np.sqrt(np.mean(e**2))) for e in errors]
            best = np.degrees(np.sqrt(bound(some, 0.0)[:, 0, 0].mean()))
            cells = " | ".join(f"{v:.3f}" for v in rms)
            lines.append(f"| {pair(tilt)} | {label}; bound {best:.3f} | {cells} |")
        lines.append(f"| {pair(tilt)} | the method's | {' | '.join(map(str, printed))} |")
    return lines


def unknown_over_known(draws: int, rng) -> list[str]:
    lines = []
    for tilt, degrees, printed in (((0, 0), 2, "1"), ((0, 0), 30, "1"), ((10, 10), 2, "6.9"),
                                   ((10, 10), 10, "5.4"), ((10, 10), 30, "1.05")):  # fmt: skip
        ratios = []
        for count in (360, 12, 36, 72):
            x = all_around(tilt, degrees, count, 0.5)
            both = [bound(x, sd)[:, 0, 0] for sd in (np.inf, 0.0)]
            middle = np.sqrt(np.median(both[0] / both[1]))
            ratios.append(middle if count == 360 else np.sqrt(both[0].mean() / both[1].mean()))
        y = np.repeat(all_around(tilt, degrees, 360, 0.5), draws, axis=0)
        values = drawn(y, rng)
        rms = []
        for mode in ("unknown", "known"):
            found = likelihood(values, y, y[0, 3], mode)
            right = right_root(found, y, np.ones_like(y))[:, None]
            e = heading_errors(np.where(right, found.angles, found.other), y)
            rms.append(np.sqrt(np.mean(e**2)))
        cells = " | ".join(f"{r:.2f}" for r in (*ratios, rms[0] / rms[1]))
        lines.append(f"| {pair(tilt)} | {degrees} | {cells} | {printed} |")
    return lines


def main(draws: int = 60) -> tuple[bool, dict[str, object]]:
    rng = np.random.default_rng(1)
    (roots, first), (level, second) = root_rows(draws, rng), sizes()
    return first and second, {
        "stop_sd": STOP_SD * 648000 / np.pi,
        "up_sd": UP_SD * np.sqrt(2) * 1000000.0,
        "draws": draws,
        "roots": roots,
        "unknown_over_known": unknown_over_known(draws, rng),
        "large_tilt": large_tilt(draws, rng),
        "level": level,
    }
