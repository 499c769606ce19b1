"""No number and no sentence of a result moves without somebody deciding that it shall.

What was kept is written again by `python tests/make_golden.py`; see CONTRIBUTING.md.
"""

from __future__ import annotations

import pytest

import make_golden as golden

QUICK = {
    "allan", "align", "ferraris", "hand_rotated", "hand_rotated_published", "multi_position",
    "north", "north_seeking", "rate_table", "six_position", "temperature", "turntable",
}  # fmt: skip
"""Cases whose first session takes less than half a second."""

RUNS = [
    pytest.param(
        case, seed, marks=() if case in QUICK and seed == 1 else pytest.mark.thorough,
        id=f"{case}-{seed}",
    )
    for case in golden.CASES
    for seed in golden.SEEDS_OF.get(case, golden.SEEDS)
]  # fmt: skip
SHOWN = 20


@pytest.mark.parametrize(("case", "seed"), RUNS)
def test_no_number_and_no_sentence_has_moved(case: str, seed: int) -> None:
    told = golden.moved(case, golden.kept(case, seed), golden.made(case, seed))
    more = f"\n... and {len(told) - SHOWN} more" if len(told) > SHOWN else ""
    assert not told, f"{case}, seed {seed}: {len(told)} moved\n" + "\n".join(told[:SHOWN]) + more


def test_what_moved_is_said_with_its_size_before_and_after() -> None:
    before = golden.kept("six_position", 1)
    value, sd = (before[f"coefficients.accel.bias.x.{key}"] for key in ("value", "sd"))
    sentence = "checks.converged.sentence"
    after = before | {"coefficients.accel.bias.x.value": value + 0.5 * sd, sentence: "It ended."}
    del after["verdict.level"]
    told = golden.moved("six_position", before, after)
    assert told[0] == f"{sentence} changed: 'The solution converged.' -> 'It ended.'"
    assert told[1] == "verdict.level: gone, 'pass'"
    assert told[2].startswith("coefficients.accel.bias.x.value moved by 0.5 sd (allowed 1e-07): ")
    assert told[2].endswith(f": {value!r} -> {value + 0.5 * sd!r}")
    assert golden.moved("six_position", before, before) == []
