"""No message fills the screen: sixty words with its cure."""

from __future__ import annotations

from foucault.symptoms import SYMPTOMS

MOST = 60
"""Words of a message and its cure [1]."""

LONGER = {
    "alignment.axes", "alignment.disagree", "alignment.sway", "alignment.turned", "gyro.axes",
    "gyro.reversed", "north.accel_sign", "north.level_sd", "rest.outliers", "session.earth_rate",
    "spin.rate_clock", "systematic.bends", "systematic.stands_for", "systematic.turn_contradicts",
    "transfer.delays", "transfer.flexure", "tumble.slow_noise",
}  # fmt: skip
"""Written before the rule, to be shortened; none may join them."""


def test_a_message_with_its_cure_has_at_most_sixty_words() -> None:
    words = {code: len(f"{row.message} {row.cure}".split()) for code, row in SYMPTOMS.items()}
    long = {code for code, n in words.items() if n > MOST}
    assert long <= LONGER, {code: words[code] for code in long - LONGER}
    assert long >= LONGER, f"Well done; take {LONGER - long} off the list."
