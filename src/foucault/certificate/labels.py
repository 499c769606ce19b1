"""The words of a certificate in each language: files beside this one, and the laboratory's own.

A file of the laboratory has a table for each language, in which a word goes before the one here; a
language of its own has to have them all::

    [en.label]
    condition = "State on arrival"
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from foucault.errors import error, listed
from foucault.files import flat, parse_toml, said_in

KNOWN = tuple(sorted(p.stem for p in (Path(__file__).parent / "labels").glob("*.toml")))
"""Languages whose words are here."""


class Labels:
    """Words in the languages of a certificate, the leading one first."""

    def __init__(self, languages: Sequence[str], own: str = "") -> None:
        """Read them; `own`: a file of the laboratory, empty for none. Raises `certificate.*`."""
        more = said_in(Path(own), "certificate.file", path=own) if own else {}
        wanted = flat(_shipped("en"))
        self.languages = tuple(languages)
        self.words: list[dict[str, str]] = []
        for language in languages:
            here = flat(_shipped(language)) if language in KNOWN else {}
            its = more.get(language)
            words = here | flat(its if isinstance(its, Mapping) else {})
            lacking = [k for k in wanted if k not in words and not k.startswith("meaning.")]
            if not words:
                raise error("certificate.language", given=language, allowed=", ".join(KNOWN))
            if lacking:
                raise error("certificate.labels", language=language, names=listed(lacking, 6))
            self.words.append({key: str(text) for key, text in words.items()})

    def said(self, key: str, **values: Any) -> list[str]:
        """Return a text in each language, those that differ from the ones before."""
        texts = [words[key].format(**values) for words in self.words]
        return list(dict.fromkeys(texts))

    def first(self, key: str, **values: Any) -> str:
        """Return a text in the leading language."""
        return self.words[0][key].format(**values)

    def number(self, text: str) -> str:
        """Write a number with the decimal sign of the leading language, and a true minus."""
        return text.replace("-", "−").replace(".", self.words[0]["decimal"])

    def meaning(self, name: str, meaning: str) -> list[str]:
        """Return what a coefficient means in each language; in English where nothing is known."""
        group, _, axes = name.rpartition(".")
        out = [f"{w[f'meaning.{group}']}, {axes}" if f"meaning.{group}" in w else meaning
               for w in self.words]  # fmt: skip
        return list(dict.fromkeys(out))


def _shipped(language: str) -> dict[str, Any]:
    file = Path(__file__).parent / "labels" / f"{language}.toml"
    return parse_toml(file.read_text(encoding="utf-8"))
