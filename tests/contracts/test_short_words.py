"""No message fills the screen: sixty words with its cure."""

from __future__ import annotations

from foucault.symptoms import SYMPTOMS

MOST = 60
"""Words of a message and its cure [1]."""


def test_a_message_with_its_cure_has_at_most_sixty_words() -> None:
    words = {code: len(f"{row.message} {row.cure}".split()) for code, row in SYMPTOMS.items()}
    assert not {code: n for code, n in words.items() if n > MOST}
