"""One exception type, one table of symptoms, and the status of a computation.

Bad input raises `FoucaultError`: what was given, what is allowed, what to do. Something the
user should know but that does not stop the work is a `Finding`. Both take their words from
the one table `foucault.symptoms`, which the documentation prints. Mathematics that fails is
neither: it is a `Status` inside the result, and its text is advice.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import PurePath

from foucault.symptoms import SYMPTOMS, doubtful

_LONG = re.compile(r"([^,\s]{200})[^,\s]{200,}([^,\s]{60})")
"""A word too long for a sentence; paths are shorter."""


_ERRNO = re.compile(r"\[[Ee]rrno -?\d+\] ")
"""What Python puts before the words of the system."""

_LARGE = re.compile(r"(?<![\w.'\"])\d(?:\.\d+)?e\+0\d\b")
"""A number such as 1.34e+04, of few digits but not too large to be written out."""


class FoucaultError(Exception):
    """Bad input: says what was given, what is allowed and what to do.

    Attributes
    ----------
    code : str
        Key of `SYMPTOMS`, shape ().
    message : str
        What was given and what is allowed, shape ().
    cure : str
        What to do, shape ().
    """

    def __init__(self, code: str, message: str, cure: str) -> None:
        super().__init__(f"{message} {cure}".strip())
        self.code = code
        self.message = message
        self.cure = cure

    def __reduce__(self) -> tuple[type[FoucaultError], tuple[str, str, str]]:
        return type(self), (self.code, self.message, self.cure)


@dataclass(frozen=True)
class Finding:
    """Something the user should know about the data; the work goes on."""

    code: str
    severity: str
    message: str
    cure: str

    def as_dict(self) -> dict[str, str]:
        """Return the finding as plain strings for result.json."""
        return asdict(self)


class Status(StrEnum):
    """How a computation ended. Anything but `CONVERGED` carries advice, not an exception."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not converged"
    UNOBSERVABLE = "unobservable"
    NOT_FINITE = "not finite"


ADVICE: dict[Status, str] = {
    Status.CONVERGED: "The solution converged.",
    Status.NOT_CONVERGED: (
        "The iteration did not settle. The usual reasons are a wrong unit, swapped axes, a rest "
        "that moved, or a start far off: run `foucault inspect` on the log and read its findings."
    ),
    Status.UNOBSERVABLE: (
        "The motion cannot tell all coefficients apart. Add rests in the directions named "
        "below, or fix the named coefficients with a prior."
    ),
    Status.NOT_FINITE: (
        "The computation met a number that is not finite. Look for saturated or missing "
        "samples with `foucault inspect`."
    ),
}


ROOM = 16  # Words that names in a message take at most [1].


def some(names: Sequence[str]) -> str:
    """Return names in a row, as many as a message has room for, and how many there are more."""
    words = shown = 0
    for name in names:
        words += len(name.split())
        if shown and words > ROOM:
            break
        shown += 1
    more = len(names) - shown
    return ", ".join(names[:shown]) + (f" and {more} more" if more else "")


def error(code: str, **values: object) -> FoucaultError:
    """Build the exception for symptom `code` with its words filled in from `values`."""
    return FoucaultError(code, *_filled(code, values))


MADE_BY = {
    "Campaign": 'foucault.load_campaign("campaign.toml") reads one.',
    "ImuModel": "foucault.ImuModel(gyro_bias=...) makes one; a result has it as result.model.",
    "ImuNoise": 'foucault.grade("tactical").noise is one; foucault.ImuNoise makes others.',
    "Log": "foucault.read_log reads one; foucault.Log(time, gyro, accel) makes one of arrays [SI].",
    "LogDescription": 'foucault.LogDescription(file="log.csv", ...) makes one; a campaign has it '
    "as campaign.log.",
    "PathLike": "Give the path of a file or folder, as text or a Path.",
    "Real": "Give a plain number [SI]; foucault.parse_unit makes one of text with a unit.",
    "Reference": "foucault.logs.reference.read reads one.",
    "Rest": "foucault.plans.manoeuvres has Rest, Straight, Turn and others, Rest(time=300).",
    "Result": 'foucault.load_result("run") reads one; foucault.calibrate makes one.',
    "Sequence": "A plan is a list of segments, such as [Rest(time=300)].",
    "Settings": "Make one of the settings by their names, Settings(heading=0.3) [SI].",
    "Start": "foucault.plans.manoeuvres.Start(latitude, longitude, ...) makes one [SI].",
    "Site": "foucault.Site.at(latitude, height) makes one [rad, m].",
    "TriadNoise": "foucault.models.noise.TriadNoise(white=...) makes one [SI].",
}
"""Where what functions take comes from."""


def require(name: str, given: object, kind: type, *others: type, none: bool = False) -> None:
    """Refuse an argument that is not of a `kind` or of `others`; `none`: None is allowed too."""
    if not (isinstance(given, (kind, *others)) or (none and given is None)):
        what = {"PathLike": "path", "Real": "number"}.get(kind.__name__, kind.__name__)
        raise error("argument.kind", name=name, given=type(given).__name__, allowed=what,
                    how=MADE_BY[kind.__name__])  # fmt: skip


def require_word(name: str, given: object, allowed: Iterable[str]) -> None:
    """Refuse an argument that is none of the words `allowed`."""
    words = tuple(allowed)
    if not (isinstance(given, str) and given in words):
        raise error("argument.word", name=name, given=given, hint=suggestion(str(given), words),
                    allowed=", ".join(words))  # fmt: skip


@contextmanager
def library(code: str, **values: object) -> Iterator[None]:
    """Raise the error of `code` where a library that is imported inside is not installed."""
    try:
        yield
    except ImportError as problem:
        raise error(code, **{"reason": problem} | values) from None


def finding(code: str, **values: object) -> Finding:
    """Build the finding for symptom `code` with its words filled in from `values`."""
    return Finding(code, SYMPTOMS[code].severity, *_filled(code, values))


@contextmanager
def doubting(findings: Iterable[Finding]) -> Iterator[None]:
    """Let an error raised inside begin with the doubts of `findings`, its likely cause."""
    try:
        yield
    except FoucaultError as problem:
        doubts = [f for f in findings if doubtful(f.code) and f.message not in problem.message]
        if not doubts or problem.code in {f.code for f in doubts}:
            raise
        message = f"{' '.join(f.message for f in doubts)} With it: {problem.message}"
        raise FoucaultError(problem.code, message, doubts[0].cure) from problem


def _filled(code: str, values: Mapping[str, object]) -> tuple[str, str]:
    """Return message and cure; damaged files hold words that no screen does."""
    row = SYMPTOMS[code]
    said = {k: str(v) if isinstance(v, PurePath | Exception) else v for k, v in values.items()}
    short = {k: _LONG.sub(r"\1 ... \2", v) if isinstance(v, str) else v for k, v in said.items()}
    texts = (_ERRNO.sub("", t.format(**short)) for t in (row.message, row.cure))
    message, cure = (_LARGE.sub(lambda large: f"{float(large[0]):.0f}", t) for t in texts)
    return message, cure


def suggestion(word: str, allowed: Iterable[str]) -> str:
    """Return ``" Did you mean 'x'?"`` for a near miss, else an empty string."""
    known = {name.lower(): name for name in allowed}
    near = difflib.get_close_matches(word.lower(), known, n=1, cutoff=0.6)
    return f" Did you mean '{known[near[0]]}'?" if near else ""


def listed(words: Sequence[str], most: int = 8) -> str:
    """Join words for a sentence, the first of them if there are more than `most`, shape () [1]."""
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more
