"""500 simulated instruments through each receiver's own file and its own formula of noise.

One set of instruments for all receivers, so that what is tested together is what one of them is
asked: 1 % of false alarms over all of that. Formulas and sources: `own_formulas`.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom, chi2

from foucault.diagnose.allan import Channel, measure
from foucault.diagnose.bounding_pair import LEAST, MOST, Pair, pair_of
from foucault.export import write
from foucault.export.densities import Densities, in_words
from foucault.export.request import AXES
from foucault.export.table import found_in, receivers
from make_terms import LOUD, with_terms
from own_formulas import T, propagated

TABLE = receivers()
WITH_NOISE = [n for n, r in TABLE.items() if any(row.noise for row in r.rows)]
TRIADS = "accel", "gyro"
RUNS, RATE = 500, 100.0


def in_file(name: str, noise: Densities, path: Path) -> tuple[dict[str, Any], str]:
    """Return what the file of a receiver has, as its reader finds it, and the whole text."""
    result = with_terms(TABLE[name].takes[0] if TABLE[name].takes else "accel.bias")
    text = write(result, name, path, noise=noise, rate=noise.rate, force=True).read_text("utf-8")
    return found_in(TABLE[name], text), text


# -- what a file lets an integral and a bias wander is what instruments do ----------------------


@cache
def wandered() -> dict[str, Any]:
    """Return integral and change of the bias after T of every instrument, (RUNS, 3) [SI]."""
    rng, n, out = np.random.default_rng(28), int(T * RATE), {}
    for triad in TRIADS:
        N, K = (LOUD.values[f"{triad}.{what}"] for what in ("white", "walk"))
        white = rng.normal(size=(RUNS, n, 3)) * N * RATE**0.5
        steps = rng.normal(size=(RUNS, n, 3)) * K / RATE**0.5
        out[triad, "white"], out[triad, "walk"] = white.sum(axis=1) / RATE, steps.sum(axis=1)
    return out


def fits(name: str, x: dict[str, Any]) -> bool:
    """Tell whether 500 instruments scatter as a file says, each axis by chi-square."""
    C_sb = np.abs(AXES[TABLE[name].axes or "right-forward-up"])
    alarm = 0.01 / (2 * len(wandered()) * 3)  # two sides, triads and noises, axes
    low, high = chi2.ppf([alarm, 1 - alarm], RUNS)
    for triad in TRIADS:
        for what, variance in zip(("white", "walk"), propagated(name, x, triad, RATE), strict=True):
            if variance is None:  # the receiver has no walk
                continue
            moved = wandered()[triad, what] @ C_sb.T
            # One number for three axes is that of the loudest, which is x.
            moved = moved if np.size(variance) == 3 else moved[:, [int(C_sb[:, 0].argmax())]]
            total = (moved**2).sum(axis=0) / variance
            if not ((low < total) & (total < high)).all():
                return False
    return True


@pytest.mark.parametrize("name", WITH_NOISE)
def test_instruments_wander_as_the_file_says(name: str, tmp_path: Path) -> None:
    x, _ = in_file(name, replace(LOUD, rate=RATE), tmp_path / "out")
    assert fits(name, x)
    for triad in TRIADS:  # and a quarter more in one number is seen
        louder = {k: v * 1.25 if triad in k and "white" in k else v for k, v in LOUD.values.items()}
        x, _ = in_file(name, replace(LOUD, rate=RATE, values=louder), tmp_path / "out")
        assert not fits(name, x)


# -- from the record of an instrument at rest to the receiver ----------------------------------

TRUE = {"accel": (2e-3, 6e-4), "gyro": (2e-4, 6e-5)}
"""N and K, with a walk that shows within a minute [SI]."""


@cache
def measured() -> list[dict[str, tuple[Channel, Pair]]]:
    """Return the Allan curve and the pair of each triad of every instrument, from a minute."""
    rng, n = np.random.default_rng(29), 6000
    out = []
    for _ in range(RUNS):
        one = {}
        for triad, (N, K) in TRUE.items():
            x = rng.normal(size=n) * N * RATE**0.5 + np.cumsum(rng.normal(size=n)) * K / RATE**0.5
            channel = measure(x, 1 / RATE)
            pair = pair_of([channel])
            assert pair is not None
            one[triad] = channel, pair
        out.append(one)
    return out


def densities_of(one: dict[str, tuple[Channel, Pair]]) -> Densities:
    values = {
        f"{all_}{triad}.{what}": np.asarray(x if all_ else np.full(3, x))
        for triad, (_, pair) in one.items()
        for what, x in (("white", pair.white), ("walk", pair.walk))
        for all_ in ("", "one:")
    }
    said = tuple(f"Noise of the {triad}: {in_words(pair)}" for triad, (_, pair) in one.items())
    return Densities(values, said, RATE, max(pair.last for _, pair in one.values()))


STATED = re.compile(r"bound the Allan curve from ([\d.e+-]+) s to ([\d.e+-]+) s")


@pytest.mark.thorough
def test_the_truth_is_in_the_interval_that_was_measured() -> None:
    """As often as 95 % means; every receiver's formula gives back what was measured, below."""
    low, high = binom.ppf([0.01 / 4, 1 - 0.01 / 4], RUNS, 0.95)
    for triad in TRIADS:
        found = [one[triad][0].noise("white") for one in measured()]
        assert low <= sum(n.low <= TRUE[triad][0] <= n.high for n in found) <= high, triad


@pytest.mark.thorough
@pytest.mark.parametrize("name", WITH_NOISE)
def test_its_formula_gives_back_what_was_measured(name: str, tmp_path: Path) -> None:
    """N to the digits of the file, and a line that bounds the curve as stated."""
    for one in measured()[:: RUNS // 20]:
        x, text = in_file(name, densities_of(one), tmp_path / "out")
        stated = STATED.findall(re.sub(r"\s*\n\W*", " ", text))
        assert len(stated) == 2
        for (triad, (channel, pair)), ends in zip(one.items(), stated, strict=True):
            white, walk = (
                None if variance is None else float(np.sqrt(np.max(variance) / T))
                for variance in propagated(name, x, triad, RATE)
            )
            assert white == pytest.approx(pair.raised * channel.noise("white").value, rel=1e-3)
            if walk is not None:
                first, last = (float(end) for end in ends)
                inside = (channel.tau >= first * 0.99) & (channel.tau <= last * 1.01)
                tau = channel.tau[inside]
                ratio = np.sqrt(white**2 / tau + walk**2 * tau / 3) / channel.deviation[inside]
                assert first <= 2.0 and last >= 30 * first
                assert ratio.min() > LEAST - 1e-3 and ratio.max() < MOST + 1e-3
