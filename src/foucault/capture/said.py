"""What a guide says, in the words of a file, so that it can be said in any language."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.capture.guide import Guide, Mistake
from foucault.capture.step import Step
from foucault.errors import error
from foucault.files import flat

AXES = ("x", "y", "z")

HALF = 0.56
"""A ratio up to this is a half [1]."""


def shipped() -> dict[str, str]:
    """Return the languages that come with the program: name -> language."""
    folder = resources.files("foucault.capture") / "words"
    files = sorted(f.name for f in folder.iterdir() if f.name.endswith(".toml"))
    tables = {name: tomllib.loads((folder / name).read_text("utf-8")) for name in files}
    return {name.removesuffix(".toml"): table["language"] for name, table in tables.items()}


@dataclass(frozen=True)
class Words:
    """The sentences of a language."""

    table: Mapping[str, Any]

    @classmethod
    def of(cls, name: str = "en") -> Words:
        """Return the words of a language that is shipped, or of a file like those."""
        if name in shipped():
            folder = resources.files("foucault.capture") / "words"
            return cls(tomllib.loads((folder / f"{name}.toml").read_text("utf-8")))
        path = Path(name)
        if not path.is_file():
            raise error("guide.words", name=name, allowed=", ".join(shipped()))
        try:
            table = tomllib.loads(path.read_text("utf-8"))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
            raise error("guide.language", name=name, reason=str(problem)) from None
        if missing := flat(cls.of().table).keys() - flat(table):
            reason = f"it has no {', '.join(sorted(missing)[:3])}"
            raise error("guide.language", name=name, reason=reason)
        return cls(table)

    def say(self, key: str, **values: Any) -> str:
        """Return a sentence, `key` as "wrong.moved"."""
        where, _, name = key.partition(".")
        return str(self.table[where][name]).format(**values)

    def step(self, step: Step, first: FloatArray | None = None) -> str:
        """Say what to do; `first` (3, 3) or None: attitude of the first rest [1]."""
        if step.kind == "turn":
            assert step.rotation is not None
            sense = "left" if step.rotation @ step.up > 0 else "right"
            return self.say("do.turn", sense=self.say(f"do.{sense}"), seconds=step.seconds)
        if step.name:
            kind = {"rest": "position", "spin": "spin", "stop": "stop"}[step.kind]
            return self.say(f"do.{kind}", name=step.name, seconds=step.seconds)
        sides = sides_below(step.up)
        kind = ("face", "edge", "corner")[len(sides) - 1]
        named = {k: self.table["side"][side] for k, side in zip("abc", sides, strict=False)}
        out = self.say(f"do.{kind}", seconds=step.seconds, **named)
        if first is not None and step.C_nb is not None:
            side = self.table["side"][facing(step.C_nb, first)]
            out += self.say("do.facing", side=side)
        return out

    def why(self, guide: Guide) -> str:
        """Say what the step is for."""
        if guide.why is None:
            done = guide.done
            return self.say("why.first") if done is None else self.say(
                "why.list", done=done[0], all=done[1])  # fmt: skip
        name, ratio = guide.why.name, guide.why.ratio
        if ratio <= HALF:
            return self.say("why.halves", name=name)
        return self.say("why.lowers", name=name, percent=100 * (1 - ratio))

    def task(self, guide: Guide) -> str:
        """Say what to do and why."""
        if guide.step is None:
            return self.end(guide)
        first = None if guide.reached is None or guide.way.gyro is False else guide.reached.C_nb
        told = first[0] if first is not None and guide.step.C_nb is not None else None
        return f"{self.step(guide.step, told)}: {self.why(guide)}"

    def now(self, guide: Guide) -> str:
        """Say what is going on."""
        left = 0.0 if guide.step is None else (1 - guide.ring) * guide.step.seconds
        return self.say(f"now.{guide.phase}", left=left)

    def wrong(self, mistake: Mistake) -> str:
        """Say what somebody did."""
        return self.say(f"wrong.{mistake.key}", **mistake.values)

    def end(self, guide: Guide) -> str:
        """Say why it stopped."""
        if guide.stopped != "floor":
            return self.say(f"end.{guide.stopped or 'list'}")
        groups = list(dict.fromkeys(guide.floored.values()))
        return self.say("end.floor", group=", ".join(groups), names=", ".join(guide.floored))

    def bars(self, guide: Guide) -> list[tuple[str, str, str, str, float]]:
        """Return rows for people: coefficient, reached, after the step, wanted, their ratio."""
        layout, out = guide.way.wanted.layout, []
        for _, name, reached, after, wanted in guide.bars():
            kind = layout.coefficients[layout.index(name)].kind
            size = wanted if np.isfinite(wanted) else reached
            unit = units.display_unit(kind, size if np.isfinite(size) else 1.0)
            factor = units.factor(unit, kind)
            texts = [f"{units.plain(x / factor, 2)} {unit}" if np.isfinite(x) else "-"
                     for x in (reached, after, wanted)]  # fmt: skip
            ratio = reached / wanted if np.isfinite(reached) else float("inf")
            out.append((name, texts[0], texts[1], texts[2], ratio))
        return out


def sides_below(up: FloatArray) -> list[str]:
    """Return the sides that are below: one of a face, two of an edge, three of a corner.

    `up` (3,): what is up, frame b [1].
    """
    order = np.argsort(-np.abs(up), kind="stable")
    strong = [i for i in order if abs(up[i]) > 0.38 * abs(up[order[0]])]
    return [("-" if up[i] > 0 else "+") + AXES[i] for i in strong]


def facing(C_nb: FloatArray, first: FloatArray) -> str:
    """Return the side that is towards who stood behind the back at the first rest.

    `C_nb`, `first` (3, 3): attitude now and at the first rest [1].
    """
    behind = first @ np.array([0.0, -1.0, 0.0])
    level = behind - behind[2] * np.array([0.0, 0.0, 1.0])
    sides = C_nb.T @ level
    i = int(np.argmax(np.abs(sides).round(6)))
    return ("+" if sides[i] > 0 else "-") + AXES[i]
