"""From files to the description of a log: what was taken, why, how sure, and what is open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import FoucaultError, error, some
from foucault.guard.mistakes import Mistake, exchanges
from foucault.logs.axes import long_enough, standstill
from foucault.logs.checks import moment
from foucault.logs.description import LogDescription
from foucault.logs.raw import instruments
from foucault.recognise import columns as tell
from foucault.recognise import physics, units
from foucault.recognise.opening import Opened, opened
from foucault.tables import AXES, usual_step

ALIKE = 1.0
"""Readings of a log that differ by less in how odd they are fit alike [1]."""

ZERO = 0.3
"""Accelerometers whose zero is farther than this part of g off have one of their own [1]."""

BITS = (8, 10, 12, 14, 16, 18, 20, 24)
"""Of converters whose counts have no sign: their zero is the middle [1]."""

MIDDLE = 0.05
"""A zero within this part of full scale of the middle is the middle, and the rest a bias [1]."""

NO_LENGTH = 0.35
"""Accelerometers whose length at rest scatters by more do not feel gravity [1]."""

FEWEST = 100
"""Rows of a log at least [1]."""

RATE_SD = "3 percent"
"""How well the usual rate that gyros fit is known: their scale factors are off by so much."""

SURE, LIKELY, TAKEN = "sure", "likely", "assumed"


@dataclass(frozen=True)
class Line:
    """One thing that was taken: what, as what, why, and how sure."""

    what: str
    took: str
    why: str
    sure: str

    def as_dict(self) -> dict[str, str]:
        """Return it as JSON has it."""
        return asdict(self)


@dataclass(frozen=True)
class Question:
    """What fits in two ways: what it is, and the line that says each."""

    what: str
    one: str
    why_one: str
    other: str
    why_other: str


@dataclass(frozen=True)
class Recognised:
    """What files hold."""

    files: tuple[Path, ...]
    log: dict[str, Any]  # [log] of a campaign
    lines: tuple[Line, ...]
    questions: tuple[Question, ...] = ()
    asked: tuple[str, ...] = ()  # what no log can say
    described: bool = False  # whether the file says itself what it holds
    titles: tuple[str, ...] = ()  # of all columns, where they were looked at

    def description(self, said: Mapping[str, Any] | None = None) -> LogDescription:
        """Return the description, with what is said instead of some of it."""
        return LogDescription.model_validate(merged(self.log, said or {}))


def merged(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with what another one says instead."""
    out = dict(one)
    for key, value in other.items():
        inner = isinstance(value, Mapping) and isinstance(out.get(key), Mapping)
        out[key] = merged(out[key], value) if inner else value
    return out


def recognise(paths: Sequence[Path], said: Mapping[str, Any] | None = None) -> Recognised:
    """Tell what files hold, which were recorded together; `said`: keys of [log] that are known."""
    said = said or {}
    files = [_opened(path, said.get("topic")) for path in paths]
    if len(files) == 1 and files[0].raw.described:
        return _of_itself(files[0], said)
    data = tell.Data.of(files)
    if len(data.x) < FEWEST:
        raise error("recognise.short", file=files[0].path.name, rows=len(data.x), least=FEWEST)
    data, dropped = _whole_rows(data)
    work = _Work(data, dict(said), dropped)
    if "rate" not in said and not tell.clocks(data):
        if (out := tell.shuffled(data)) is not None:
            raise error("recognise.order", file=files[0].path.name, column=data.shown(out[0]),
                        share=f"{100 * out[1]:.2g}")  # fmt: skip
        work.take_rate()
    return work.done()


def _opened(path: Path, topic: str | None) -> Opened:
    """Open a file; of messages that tell the same of one instrument take those that say most."""
    try:
        return opened(path, topic)
    except FoucaultError as problem:
        names = instruments(path) if problem.code == "log.several_topics" else []
        if len(names) != 1:
            raise
        return opened(path, names[0])


def _of_itself(file: Opened, said: Mapping[str, Any]) -> Recognised:
    kind = "this program wrote it" if file.raw.marker else "its format says it"
    named = ", ".join(name for name in (file.raw.declared or {}) if name != "clock")
    line = Line("columns", named, kind, SURE)
    log = merged({"file": file.path.name} | file.layout, said)
    titles = tuple(map(str, getattr(file.raw, "names", ())))
    return Recognised((file.path,), log, (line,), described=True, titles=titles)


def _whole_rows(data: tell.Data) -> tuple[tell.Data, int]:
    """Return the columns that are nearly full, and only rows without holes in these."""
    full = np.isfinite(data.x)
    kept = np.flatnonzero(full.mean(axis=0) > 0.5)
    if len(kept) < 3:
        raise error("recognise.holes", file=data.files[0].path.name)
    rows = full[:, kept].all(axis=1)
    if rows.mean() < 0.3:
        raise error("recognise.holes", file=data.files[0].path.name)
    columns = tuple(data.columns[k] for k in kept)
    x = data.x[np.ix_(rows, kept)]
    return tell.Data(data.files, columns, x, data.joined), int((~rows).sum())


@dataclass
class _Work:
    """One log being recognised."""

    data: tell.Data
    said: dict[str, Any]
    dropped: int
    lines: list[Line] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    told: str = ""  # what says the rate beside the columns

    def take_rate(self) -> None:
        """Take the rate that times of day give, or that the lines above the data say."""
        for file, c in self._lost("time"):
            if rate := tell.rate_of_day(file, c):
                self.said |= {"rate": f"{rate:.9g} Hz", "clock": "host"}
                self.told = f"the mean of '{file.raw.names[c]}', whose times of day are even"
                return
        if (head := self.data.files[0].rate) is not None:
            self.said["rate"], self.told = f"{head:.10g} Hz", "the lines above the data say it"

    def _lost(self, role: str) -> list[tuple[Opened, int]]:
        """Return the columns that titles call a `role` and that hold words, or nothing."""
        return [(file, c) for file in self.data.files if file.raw.named for c in file.left_out
                if tell.meaning_of(file, c).role == role]  # fmt: skip

    def _readable(self) -> None:
        """Refuse a triad that titles name and that cannot be taken as it is written."""
        for i, name in enumerate(("accel", "gyro")):
            columns = getattr(self.found, name)
            lost = self._lost(name)
            said = ", ".join(file.raw.names[c] for file, c in lost)
            if lost and not (columns is not None and self.found.titled[i]):
                file, c = lost[0]
                next(file.raw.blocks((c,)), None)  # raises where, and what stands there
                if name == "accel" or len(lost) % 3:
                    raise error("recognise.unread", file=file.path.name, columns=said)
                self.lines.append(Line("gyros", "none", f"{said} are empty", SURE))
            units_ = {self.data.columns[k].means.unit for k in columns or ()}
            given = ", ".join(self.data.shown(k) for k in columns or ())
            if len(units_) > 1 and "" not in units_ and not self._said(name):
                raise error("recognise.mixed_units", columns=given, **self._file())
            if columns and tell.wrapped(self.data.x[:, list(columns)]):
                raise error("recognise.unsigned", columns=given, **self._file())

    def _no_gyros(self, used: Sequence[int]) -> None:
        """Refuse columns without titles which may be gyros, and which turn no gravity."""
        found, data = self.found, self.data
        if found.accel is None or found.gyro is not None or found.why[0] != "numbers":
            return
        left = [k for k, column in enumerate(data.columns)
                if k not in (*found.accel, *used) and not column.means.role
                and np.ptp(data.x[:, k]) > 0]  # fmt: skip
        if len(left) >= 3:
            raise error("recognise.no_gyros", columns=", ".join(data.shown(k) for k in left),
                        accel=self._columns_line("accel", found.accel),
                        gyro=self._columns_line("gyro", left[:3]), **self._file())  # fmt: skip

    def _file(self) -> dict[str, str]:
        return {"file": self.data.files[0].path.name}

    def done(self) -> Recognised:
        data = self.data
        clock = None if "rate" in self.said else next(iter(tell.clocks(data)), None)
        used = [*([] if clock is None else [clock.column]), *tell.counters(data)]
        used += [c.column for c in tell.clocks(data)]
        self.found, self.clock = found, clock = self._triads(used), clock
        self._readable()
        if found.accel is None and found.gyro is None:
            if tell.named(data, "mag"):
                raise error("recognise.mag_alone", have=self._have(), **self._file())
            raise error("recognise.no_triad", have=self._have(), **self._file())
        self._no_gyros(used)
        every = [*(found.accel or ()), *(found.gyro or ())]
        if (number := tell.in_turns(data.x[:, every])) > 1:
            raise error("recognise.in_turns", number=number, **self._file())
        time = np.arange(len(data.x)) * 1.0
        if clock is not None:
            time = tell.unwrapped(data.x[:, clock.column]) - data.x[0, clock.column]
        self.time: FloatArray = np.ascontiguousarray(time)
        self.cut = physics.blocks(data.x, every)
        self.ball = self._ball()
        if self.ball is not None and len(self.cut.rests[0]) > 3 and self.ball.scatter > NO_LENGTH:
            self._living()
            shown = ", ".join(data.shown(k) for k in self.ball.columns)
            raise error("recognise.no_gravity", columns=shown, **self._file())
        self.turned = self._turned()
        self._alive()
        reading = self._units()
        gyro, accel = self._axes(reading)
        if self.questions:
            self._living()
        log = self._log(reading, accel, gyro)
        return Recognised(
            tuple(f.path for f in data.files), log, tuple(self.lines), tuple(self.questions),
            titles=tuple(str(name) for f in data.files for name in f.raw.names),
        )  # fmt: skip

    # -- which columns -------------------------------------------------------------------------

    def _triads(self, used: Sequence[int]) -> tell.Triads:
        given = {
            name: block["columns"]
            for name in ("accel", "gyro")
            if isinstance(block := self.said.get(name), Mapping) and block.get("columns")
        }
        found = tell.triads(self.data, used)
        open_ = tuple(one for one in found.several if one[0] not in given)
        if found.accel is None and (linear := tell.named(self.data, "linear")):
            shown = ", ".join(self.data.shown(k) for k in linear[0][1])
            self.lines.append(
                Line("accelerometers", "none", f"{shown}: gravity was taken off", SURE)
            )
        if open_:
            self._several(found, open_)
        if not given:
            return found
        chosen = {name: self._numbers(names) for name, names in given.items()}
        return tell.Triads(chosen.get("accel", found.accel), chosen.get("gyro", found.gyro),
                           (True, True), found.increments, (), ("said", "said"))  # fmt: skip

    def _numbers(self, names: Sequence[Any]) -> tuple[int, int, int]:
        known = {str(self.data.called(k)): k for k in range(len(self.data.columns))}
        known |= {str(c.number): k for k, c in enumerate(self.data.columns)}
        try:
            x, y, z = (known[str(name).removeprefix("-")] for name in names)
        except (KeyError, ValueError):
            allowed = some([str(self.data.called(k)) for k in range(len(self.data.columns))])
            raise error("recognise.said", given=str(list(names)), allowed=allowed) from None
        return x, y, z

    def _several(self, found: tell.Triads, open_: Sequence[tuple[str, tuple[int, ...]]]) -> None:
        """Ask which of several triads is meant."""
        first = {"accel": found.accel, "gyro": found.gyro}
        kinds = list(dict.fromkeys(kind for kind, _ in open_))
        said = " and of ".join(_KIND[kind] for kind in kinds)
        one = "; ".join(self._columns_line(k, columns) for k in kinds if (columns := first[k]))
        other = "; ".join(self._columns_line(k, dict(reversed(open_))[k]) for k in kinds)
        what = f"There are several triads of {said}."
        why = "the next" if len(kinds) == 1 else "the next; both: `two_imus`"
        self.questions.append(Question(what, one, "the first", other, why))

    def _columns_line(self, kind: str, columns: Sequence[int]) -> str:
        names = [self.data.called(k) for k in columns]
        if not all(isinstance(n, str) and n.replace("_", "").isalnum() for n in names):
            names = [self.data.columns[k].number for k in columns]
        return f"{kind}.columns = [{', '.join(map(str, names))}]"

    def _have(self) -> str:
        return some([self.data.shown(k) for k in range(len(self.data.columns))])

    # -- what the numbers say ------------------------------------------------------------------

    def _ball(self) -> physics.Sphere | None:
        accel = self.found.accel
        if accel is None:
            return None
        if len(self.cut.rests[0]):
            ball = physics.sphere(self.cut.of_rests(accel), accel)
            if ball is not None:
                return ball
        radius = float(np.median(np.linalg.norm(self.data.x[:, list(accel)], axis=1)))
        return physics.Sphere(accel, np.zeros(3), radius, 1.0, 0.0) if radius > 0 else None

    def _turned(self) -> physics.Turns | None:
        if self.ball is None or self.found.gyro is None:
            return None
        found = physics.turns(self.data.x, self.time, self.cut, self.ball, self.found.gyro)
        # One turn, of any scale, fits one of 48 orders by chance: titles go before it.
        if found is not None and found.turns < 2 and self.found.titled[1]:
            return found if any(np.array_equal(E, np.eye(3)) for E in found.fitting) else None
        return found

    def _living(self) -> None:
        """Refuse a column that repeats one reading, of a log that cannot be made out otherwise."""
        for k in (*(self.found.gyro or ()), *(self.found.accel or ())):
            lost = standstill(self.data.x[:, k], long_enough(usual_step(np.diff(self.time))))
            if lost is not None:
                start, end = (moment(self.time[row] - self.time[0]) for row in lost)
                raise error("recognise.lost", start=start, end=end,
                            column=self.data.shown(k), **self._file())  # fmt: skip

    def _alive(self) -> None:
        """Refuse a triad one column of which never changes, or whose gyros turn otherwise."""
        data, found, turned = self.data, self.found, self.turned
        moves = self.ball is not None and self.ball.spread > 0.3 and len(self.cut.rests[0]) > 1
        for triad, columns in (("accel", found.accel), ("gyro", found.gyro)):
            dead = [k for k in columns or () if np.ptp(data.x[:, k]) == 0]
            shown = ", ".join(data.shown(k) for k in dead)
            if len(dead) == 3 and triad == "gyro":
                self.lines.append(Line("gyros", "none", f"{shown} never change", SURE))
                self.found = replace(found, gyro=None)
            elif dead and moves:
                raise error("recognise.stuck", columns=shown, triad=triad, **self._file())
        known = self._said("gyro") or self._titled(found.gyro)
        # What is only shaken, as in a vehicle, misses by less; spins by errors of their scale.
        may = physics.ON_THE_WAY + physics.SPUN * self._way_turned()
        far = turned is not None and turned.turns > 2 and turned.miss > may
        told = self.ball is not None and self.ball.scatter < physics.NORM
        if turned is not None and far and told and not known:
            self._living()
            shown = ", ".join(data.shown(k) for k in found.gyro or ())
            raise error("recognise.no_turns", turns=turned.turns, off=np.degrees(turned.miss),
                        columns=shown, **self._file())  # fmt: skip

    def _way_turned(self) -> float:
        """Return the angle turned on the way from a rest to the next, on average [rad].

        0 where the fit would turn by half a turn and more from one reading to the next: no log
        shows such turns, so that it is the fit which is wrong.
        """
        turned, gyro = self.turned, self.found.gyro
        if turned is None or gyro is None:
            return 0.0
        w = turned.scale * np.linalg.norm(self.data.x[:, list(gyro)] - turned.bias, axis=1)
        steps = w[1:] * np.diff(self.time)
        slow = np.nanmax(steps, initial=0.0) < np.pi
        return float(np.nansum(steps)) / max(turned.turns, 1) if slow else 0.0

    def _titled(self, columns: Sequence[int] | None) -> str:
        """Return the unit that the titles of a triad give, "" where they give none or several."""
        given = {self.data.columns[k].means.unit for k in columns or ()}
        return given.pop() if len(given) == 1 else ""

    def _units(self) -> units.Reading:
        found, data, clock = self.found, self.data, self.clock
        whole = tuple(
            columns is not None and bool(np.all(x := data.x[:, list(columns)] % 1.0 == 0.0))
            and bool(np.size(x))
            for columns in (found.accel, found.gyro)
        )  # fmt: skip
        peak = still = 0.0
        if found.gyro is not None:
            y = data.x[:, list(found.gyro)]
            # Nothing turns but the Earth.
            alone = self.ball is not None and self.ball.spread < 0.02 and self.turned is None
            still = float(np.linalg.norm(y.mean(axis=0))) if alone else 0.0
            peak = float(np.percentile(np.abs(y - np.median(y, axis=0)), 99.9))
        turn = self.turned.scale if self.turned is not None and self.turned.fits else None
        given = tuple(name for name in ("time", "accel", "gyro") if self._said(name))
        titled = units.Titled(
            self._clock_unit(), self._said("accel") or self._titled(found.accel),
            self._said("gyro") or self._titled(found.gyro), given, self._scales(),
        )  # fmt: skip
        seen = units.Seen(
            1.0 if clock is None else clock.interval, clock is not None,
            None if self.ball is None else self.ball.radius, turn, peak, still,
            (whole[0], whole[1]), found.increments,
        )  # fmt: skip
        rate = self.said.get("rate")
        ranked = units.readings(seen, titled)
        if isinstance(rate, str) and clock is None:
            from foucault.units import parse

            hertz = parse(rate, "frequency", "rate")
            seen = replace(seen, interval=1.0 / hertz, timed=True, turn=turn and turn * hertz)
            known = replace(titled, time="s", given=(*given, "time"))
            ranked = [replace(r, time=None) for r in units.readings(seen, known)]
        if not ranked:
            raise error("recognise.units", file=data.files[0].path.name, said=self._sizes(seen))
        best = ranked[0]
        other = next((r for r in ranked[1:] if not r.like(best)), None)
        untold = best.time is None and turn is None and self._spins()
        if (best.hangs or untold) and not isinstance(rate, str):
            self._ask_rate(best)
        elif other is not None and other.cost - best.cost < ALIKE:
            self._ask_units(best, other)
        self.sure = SURE if other is None or other.cost - best.cost > 2.5 else LIKELY
        return best

    def _said(self, triad: str) -> str:
        block = self.said.get(triad)
        return str(block.get("unit", "")) if isinstance(block, Mapping) else ""

    def _scales(self) -> dict[str, tuple[str, float]]:
        """Return what is said of the counts of the triads, as texts and per count [SI]."""
        from foucault.units import parse

        out = {}
        for triad, kind in (("accel", "accelerometer count scale"), ("gyro", "gyro count scale")):
            block = self.said.get(triad)
            said = block.get("scale") if isinstance(block, Mapping) else None
            one = said[0] if isinstance(said, list) and said else said
            if isinstance(one, str):
                out[triad] = one, 1.0 / parse(one, kind, f"{triad}.scale")
        return out

    def _clock_unit(self) -> str:
        if said := self._said("time"):
            return said
        if self.clock is None:
            return ""
        if self.clock.dates:
            return "iso"
        unit = self.data.columns[self.clock.column].means.unit
        return unit if unit in ("s", "ms", "us", "ns", "min", "day") else ""

    def _sizes(self, seen: units.Seen) -> str:
        parts = [f"{'an interval' if seen.timed else 'rows'} of {seen.interval:.6g}"]
        if seen.radius:
            parts.append(f"accelerometers of length {seen.radius:.6g} at rest")
        if seen.turn:
            parts.append(f"gyros of {seen.turn:.6g} rad for one of them and one of the clock")
        return ", ".join(parts)

    def _ask_rate(self, best: units.Reading) -> None:
        assert best.gyro is not None
        other = 200 if round(best.rate) != 200 else 100
        why, then = ("gyros in counts do not tell the rate", f"then {best.gyro.scale}") \
            if best.hangs else ("it spins about the vertical, which does not either",
                                "what is usual")  # fmt: skip
        self.questions.append(Question(
            f"There is no time column, and {why}.", f"rate = {best.rate:.4g} Hz", then,
            f"rate = {other} Hz", "or what the logger was set to"))  # fmt: skip

    def _spins(self) -> bool:
        """Tell whether gyros turn steadily, several times and by far."""
        if self.ball is None or self.found.gyro is None or not len(self.cut.rests[0]):
            return False
        y = self.data.x[:, list(self.found.gyro)]
        bias = np.median(self.cut.of_rests(self.found.gyro), axis=0)
        return len(list(physics.steady_spins(self.data.x, self.ball.columns, y - bias))) > 3

    def _ask_units(self, one: units.Reading, other: units.Reading) -> None:
        def line(r: units.Reading, differs: units.Reading) -> str:
            parts = []
            if r.time and differs.time and r.time.text != differs.time.text:
                parts.append(f"time.unit = {r.time.text}")
            if r.time is None and abs(r.rate / differs.rate - 1) > 1e-6:
                parts.append(f"rate = {r.rate:g} Hz")
            if r.gyro and differs.gyro and r.gyro.text != differs.gyro.text:
                parts.append(f"gyro.unit = {r.gyro.text}")
            if r.gyro and differs.gyro and r.gyro.scale and r.gyro.scale != differs.gyro.scale:
                parts.append(f"gyro.scale = {r.gyro.scale}")
            if r.increments != differs.increments:
                kind = "increment" if r.increments else "rate"
                parts.append(f"accel.kind = {kind}; gyro.kind = {kind}")
            return "; ".join(parts)

        first, second = line(one, other), line(other, one)
        if first == second:
            return
        counts = "gyro.scale" in first and "gyro.scale" in second
        what = "Nothing tells how large the gyros' counts are." if counts \
            else "Two sets of units fit."  # fmt: skip
        self.questions.append(Question(what, first, _whys(one), second, _whys(other)))

    # -- axes ----------------------------------------------------------------------------------

    def _axes(self, reading: units.Reading) -> tuple[FloatArray, FloatArray]:
        """Return the signed permutations of the columns of gyros and accelerometers."""
        same = np.eye(3)
        turned, (accel_titled, gyro_titled) = self.turned, self.found.titled
        if turned is None or not turned.fits:
            why = "the titles" if gyro_titled or accel_titled else "the order of the columns"
            tell_ = (
                "no turns tell"
                if turned is None or turned.turns < 3
                else f"{turned.turns} turns do not fit: off by {np.degrees(turned.miss):.0f} deg"
            )
            if self.found.gyro is not None and self.found.accel is not None:
                self.lines.append(Line("axes", "x, y, z as they are", f"{why}; {tell_}", TAKEN))
            return same, same
        fits = any(np.array_equal(E, same) for E in turned.fitting)
        sure = SURE if turned.proved else LIKELY
        # Titles that name all axes are believed where turns do not speak against them.
        if fits and (len(turned.fitting) == 1 or (accel_titled and gyro_titled)):
            self.lines.append(Line("axes", "gyros and accelerometers in the same axes",
                                   self._turn_words(turned), sure))  # fmt: skip
            return same, same
        costs = sorted(
            ((self._oddness(R, E), R, np.linalg.det(R) * R @ E)
             for E in turned.fitting for R in exchanges()),
            key=lambda one: one[0],
        )  # fmt: skip
        _, R, E = costs[0]
        other = next((o for o in costs[1:] if not np.array_equal(
            np.linalg.det(o[1]) * o[1].T @ o[2], np.linalg.det(R) * R.T @ E)), None)  # fmt: skip
        if other is not None:
            self.questions.append(Question(
                "Two orders of the gyros' axes fit.", self._signed_line(E), "it is as simple",
                self._signed_line(other[2]), "it fits as well"))  # fmt: skip
        took = [f"{_KIND[name]} {self._words(name, M)}" for name, M in (("accel", R), ("gyro", E))
                if not np.array_equal(M, same)]  # fmt: skip
        self.lines.append(Line("axes", "; ".join(took), self._turn_words(turned), sure))
        return E, R

    def _turn_words(self, turned: physics.Turns) -> str:
        return (f"{turned.turns} turns predict gravity within {np.degrees(turned.miss):.1f} deg; "
                f"the next best order {np.degrees(turned.other):.0f} deg")  # fmt: skip

    def _oddness(self, R: FloatArray, E: FloatArray) -> float:
        """How odd it is that accelerometers are changed by R and gyros by E before that."""
        gyro = np.linalg.det(R) * R @ E
        titled = self.found.titled
        return _odd(R, titled[0]) * 1.001 + _odd(gyro, titled[1])

    def _words(self, triad: str, E: FloatArray) -> str:
        columns = self.found.accel if triad == "accel" else self.found.gyro
        assert columns is not None
        shown = [self.data.shown(k, sign) for k, sign in _moved(columns, E)]
        return ", ".join(f"{a} = {name}" for a, name in zip(AXES, shown, strict=True))

    def _signed_line(self, E: FloatArray) -> str:
        assert self.found.gyro is not None
        names = [str(self.data.called(k, sign)) for k, sign in _moved(self.found.gyro, E)]
        return f"gyro.columns = [{', '.join(names)}]"

    # -- [log] ---------------------------------------------------------------------------------

    def _log(self, reading: units.Reading, accel: FloatArray, gyro: FloatArray) -> dict[str, Any]:
        data, found = self.data, self.found
        log: dict[str, Any] = {}
        several = len(data.files) > 1
        if not several:
            log["file"] = data.files[0].path.name
        log |= data.files[0].layout
        first: list[Line] = []

        def put(block: str, said: dict[str, Any], column: int) -> None:
            log[block] = said | ({"file": data.file(column).name} if several else {})

        why = self._no_clock(reading)
        if reading.time is not None and why:
            rate = (len(self.time) - 1) / (self.time[-1] * reading.time.si)
            log |= {"rate": f"{rate:.9g} Hz", "clock": "host"}
            first.append(Line("rate", f"{rate:.6g} Hz", why, SURE))
        elif self.clock is not None and reading.time is not None:
            one = reading.time.text
            log["time"] = {"column": data.called(self.clock.column), "unit": one}
            first.append(Line("time", f"{data.shown(self.clock.column)} [{one}], "
                              f"{reading.rate:.6g} Hz", _why(reading.time, self.clock.titled),
                              SURE if reading.time.why == "title" else self.sure))  # fmt: skip
        else:
            log["rate"] = f"{reading.rate:.10g} Hz"
            given = isinstance(self.said.get("rate"), str)
            if not given:
                log["clock_sd"] = RATE_SD
            told = self.turned is not None and self.turned.fits
            lost = self._lost("time")
            stood = [data.shown(k) for k, c in enumerate(data.columns) if c.means.role == "time"]
            none = (
                f"'{lost[0][0].raw.names[lost[0][1]]}' cannot be read"
                if lost
                else f"{stood[0]} stands still or runs backward"
                if stood
                else "no time column"
            )
            why = f"{none}; the gyros' turns fit it, and their scale hangs on it" if told \
                else f"{none}, and nothing tells it"  # fmt: skip
            first.append(Line("rate", f"{reading.rate:.6g} Hz",
                              self.told if self.told else
                              "given" if given else
                              f'{why}: else --set "rate = 50 Hz"',
                              SURE if given else TAKEN))  # fmt: skip
        for name, columns, unit, E in (
            ("accel", found.accel, reading.accel, accel), ("gyro", found.gyro, reading.gyro, gyro),
        ):  # fmt: skip
            if columns is None or unit is None:
                continue
            block = self._block(name, columns, unit, E, reading.increments)
            zero = block.get("zero", [])
            middle = f"; zero: {zero[0]:.0f}, the middle of its counts" if len({*zero}) == 1 else ""
            put(name, block, columns[0])
            shown = ", ".join((data.shown(k, sign) for k, sign in _moved(columns, E)))
            size = unit.scale or unit.text
            first.append(Line(_KIND[name], f"{shown} [{size}]" + " sums" * reading.increments,
                              self._triad_why(name, unit) + middle,
                              self._how_sure(name, unit)))  # fmt: skip
        first += self._sign(log)
        field = tell.magnetometer(data)
        if field is not None:
            block = {"columns": [data.called(k) for k in field[0]], "unit": field[1]}
            put("mag", block, field[0][0])
            shown = ", ".join(data.shown(k) for k in field[0])
            why = "titles" if field[2] else "titles; unit: the field of the Earth"
            first.append(Line("magnetometer", f"{shown} [{field[1]}]", why,
                              SURE if field[2] else LIKELY))  # fmt: skip
        warm = tell.temperature(data)
        if warm is not None:
            put("temperature", {"column": data.called(warm[0]), "unit": warm[1]}, warm[0])
            why = "title" if warm[2] else "title; unit: what instruments are as warm as"
            first.append(Line("temperature", f"{data.shown(warm[0])} [{warm[1]}]", why,
                              SURE if warm[2] else LIKELY))  # fmt: skip
        if data.joined:
            log["join"] = "times"
            why = "stamps of both are taken for those of one clock"
            first.append(Line("files", "joined by their times, the faster averaged", why, TAKEN))
        if self.dropped:
            log["missing"] = "drop"
            first.append(Line("rows", f"{self.dropped} left out", "a reading is missing", SURE))
        self.lines[:0] = first
        return merged(log, {key: self._final(key, value) for key, value in self.said.items()})

    def _no_clock(self, reading: units.Reading) -> str:
        """Return why the mean interval of even rows goes before the stamps of each, else ""."""
        step = np.diff(self.time)
        line = np.linspace(self.time[0], self.time[-1], len(self.time))
        even = bool(np.abs(self.time - line).max() < 0.1 * step.mean())
        falls = self.clock is not None and bool(
            (np.diff(self.data.x[:, self.clock.column]) < 0).any()
        )
        if falls and even:
            return "the counter of the time column begins again, its rows are even"
        # Increments are divided by the interval, which a rounded clock only has on average.
        if even and reading.increments and bool(np.ptp(step) > 2e-3 * step.mean()):
            return "the time column is rounded, its rows are even"
        return ""

    def _final(self, key: str, said: Any) -> Any:
        """Return what is said of a block; the signs of columns said without one are told."""
        if not isinstance(said, Mapping) or key not in ("accel", "gyro"):
            return said
        signed = any(str(name).startswith("-") for name in said.get("columns", ()))
        return {k: v for k, v in said.items() if k != "columns" or signed}

    def _sign(self, log: dict[str, Any]) -> list[Line]:
        accel = self.found.accel
        if accel is None or "accel" not in log:
            return []
        gravity = self.data.columns[accel[0]].means.gravity
        if gravity:
            log["accel"]["reads"] = "gravity"
            return [Line("sign", "accelerometers read gravity, -1 g up", "its logger does", LIKELY)]
        return [Line("sign", "specific force, +1 g up",
                     'a log cannot tell; else --set "accel.reads = gravity"', TAKEN)]  # fmt: skip

    def _how_sure(self, name: str, unit: units.Unit) -> str:
        proved = self.turned is not None and self.turned.fits
        by_numbers = self.found.why[0 if name == "accel" else 1] == "numbers"
        if unit.why.startswith("not") or (by_numbers and not proved):
            return LIKELY
        return SURE if unit.why in ("title", "gravity, and a usual converter") else self.sure

    def _triad_why(self, name: str, unit: units.Unit) -> str:
        where = self.found.why[0 if name == "accel" else 1]
        fits = self.turned is not None and self.turned.fits
        numbers = (
            "one length at rest"
            if name == "accel"
            else "rest near zero, turn gravity"
            if fits
            else "beside the accelerometers"
        )
        columns = {"titles": "titles", "said": "given"}.get(where, numbers)
        columns = where if where.startswith("numbers:") else columns
        if name == "accel" and self.ball is not None and unit.why in ("gravity", "gravity alone"):
            return f"{columns}; length {self.ball.radius:.5g} at rest"
        return f"{columns}; unit: {unit.why}"

    def _block(
        self, name: str, columns: Sequence[int], unit: units.Unit, E: FloatArray, increments: bool
    ) -> dict[str, Any]:
        block: dict[str, Any] = {
            "columns": [self.data.called(k, sign) for k, sign in _moved(columns, E)],
            "unit": unit.text,
        }
        zero = None
        if name == "accel" and self.ball is not None:
            far = float(np.abs(self.ball.centre).max()) > ZERO * self.ball.radius
            zero = self.ball.centre if far else None
        elif name == "gyro":
            x = self.data.x[:, list(columns)]
            at_rest = np.median(x, axis=0)
            k = int(np.argmax(np.abs(at_rest)))
            # In a log that hardly rests it is a rate, but not of readings that never cross nought.
            far = abs(at_rest[k] * unit.si) > 1.0 and x[:, k].min() * x[:, k].max() > 0
            zero = at_rest if far and unit.why != "title" and not increments else None
        if zero is not None and not increments:
            if middle := _middle(self.data.x[:, list(columns)], zero):
                zero = np.full(3, middle)
            place = np.argmax(np.abs(E), axis=1)
            block["unit"] = "count"
            block["scale"] = unit.scale or (
                f"{1 / unit.si:.8g} count/({'m/s^2' if name == 'accel' else 'rad/s'})")  # fmt: skip
            # The reader takes the zero off before it turns the sign round.
            block["zero"] = [float(f"{zero[k]:.6g}") for k in place]
        elif unit.text == "count":
            block["scale"] = unit.scale
        if increments:
            block["kind"] = "increment"
        return block


def _middle(x: FloatArray, zero: FloatArray) -> float | None:
    """Return the middle of the converter that counts `x` (n, 3), where `zero` (3,) is about it."""
    if x.min() < 0:
        return None
    middle = next((2.0 ** (n - 1) for n in BITS if x.max() < 2**n), None)
    near = middle is not None and np.abs(zero - middle).max() < MIDDLE * middle
    return middle if near else None


_KIND = {"accel": "accelerometers", "gyro": "gyros"}


def _odd(E: FloatArray, titled: bool) -> float:
    """How odd a change of columns is: their order says little where no title names the axes."""
    mistake = Mistake(exchange=E)
    moved, signs = 3.0 - float(np.trace(np.abs(E))), float(np.sum(E < 0))
    return mistake.weight if titled else 0.15 * moved + 0.6 * signs


def _moved(columns: Sequence[int], E: FloatArray) -> list[tuple[int, float]]:
    """Return the columns that a signed permutation E makes x, y, z, and their signs."""
    return [(columns[k], float(row[k])) for row, k in zip(E, np.abs(E).argmax(axis=1), strict=True)]


def _why(unit: units.Unit, titled: bool) -> str:
    return f"{'title' if titled else 'it runs on evenly'}; unit: {unit.why}"


def _whys(r: units.Reading) -> str:
    parts = [] if r.gyro is None else [f"gyros in {r.gyro.scale or r.gyro.text}: {r.gyro.why}"]
    return "; ".join([f"{r.rate:.4g} Hz", *parts])


def question(found: Recognised) -> FoucaultError:
    """Return the error that shows both readings of the first question."""
    one = found.questions[0]
    return error("recognise.two_ways", file=found.files[0].name, what=one.what, one=one.one,
                 why_one=one.why_one, other=one.other, why_other=one.why_other)  # fmt: skip
