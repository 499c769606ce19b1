"""The page of data sheets: what is known of common instruments, and where from."""

from __future__ import annotations

from foucault.models.parts import QUANTITIES, Part, catalogue, size_text, sizes_of

HEAD = """\
# Data sheets

What data sheets say of common instruments, for the [noise](models/noise.md) of a campaign and for
the sizes of what a calibration leaves out. `foucault parts` lists them, `foucault parts NAME`
prints one with the wording of every number, and

```text
[noise]
part = "ICM-20948"
```

takes the white noise of one. `part` in `[instrument]` takes its class and the sizes of
[what is not estimated](left_out.md). `foucault init hand_rotated --part ICM-20948` writes both. A
number stands here as its source has it. What is missing is not stated, or stands on a page that
was not at hand; nothing is filled in. Check the sheet of your own instrument before you rely on it.

*typical* counts as one standard deviation, a *limit* (max) as two. A nonlinearity e of the full
scale X allows a quadratic term of 2 e / X, or a cubic one of 4 e / X^2; a noise density is
one-sided, so that the random walk is the density over the root of 2. A drift is the change by
temperature over 1 K from start to end of a session after warming up, which is a judgement.
Cross-axis sensitivity is a misalignment: it is no size of terms of second order.

Sources that are marked quote the data sheet, they are not it.
"""


def page() -> str:
    """Return the page as Markdown."""
    lines = [HEAD, "| part | maker | grade |", "|---|---|---|"]
    lines += [f"| [{n}](#{n.lower()}) | {p.maker} | {p.grade} |" for n, p in catalogue().items()]
    for one in catalogue().values():
        lines += _of(one)
    return "\n".join(lines) + "\n"


def _of(one: Part) -> list[str]:
    numbered = list(dict.fromkeys(one.sources.values()))
    lines = ["", f"## {one.name}", ""]
    for i, source in enumerate(numbered, 1):
        second = "" if source.primary else " (quotes the data sheet)"
        lines.append(f"{i}. {source.title}{second}: {source.address}")
    lines += ["", "| number | value | meant as | source, page |", "|---|--:|---|---|"]
    for key in QUANTITIES:
        if (said := one.numbers.get(key)) is not None:
            value = said.text + (f" of {said.over}" if said.over else "")
            where = f"{numbered.index(one.sources[key]) + 1}, {said.page}"
            lines.append(f"| {key} | {value} | {said.meant} | {where} |")
    if sizes := sizes_of(one.name):
        lines += ["", "| left out | size, 1 sd |", "|---|--:|"]
        lines += [f"| {group} | {size_text(group, size)} |" for group, (size, _) in sizes.items()]
    return lines
