"""What is exported: the model in the axes of the receiver, and what is said about it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import error, suggestion
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.layouts import of_one_sample, of_sensors
from foucault.models.size_effect import LAYOUT as SIZE_EFFECT
from foucault.models.size_effect import SizeEffect
from foucault.models.temperature import TemperatureModel, without
from foucault.result import Level, Result
from foucault.run_folder import RESULT_FILE

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription, Triad


ALL = Layout((*LAYOUT.coefficients, *SIZE_EFFECT.coefficients))
"""Every coefficient that can be exported."""


def family(name: str) -> str:
    """Return the kind of coefficient `name`: its triad and what it is."""
    return ".".join(name.split(".")[:2])


FAMILIES = tuple(dict.fromkeys(family(name) for name in ALL.names))
"""Kinds of coefficients: accel.bias, accel.scale, ... gyro.deflection, accel.lever, accel.delay."""

EXPORTED = b"Calibration by foucault"  # With this every exported file begins to say what it is.

OWN_AXES = "right-forward-up"
AXES: dict[str, FloatArray] = {
    OWN_AXES: np.eye(3),
    "forward-right-down": np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    "forward-left-up": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
}
"""Axes a receiver may have its readings in, as C_sb: x_s = C_sb @ x_b."""


@dataclass(frozen=True)
class Counts:
    """Raw counts of one triad: SI = (count - zero) * factor, in the axes of the export."""

    columns: tuple[str, ...]  # the columns of the log, in the order the counts are to be given
    zero: FloatArray  # (3,) count that means zero [count]
    factor: FloatArray  # (3,) SI value of one count, with the sign of the axis [SI/count]


@dataclass(frozen=True)
class Request:
    """One export."""

    result: Result  # where the coefficients come from
    model: ImuModel  # their matrices without what is dropped, input and output in `axes` [SI]
    size: SizeEffect  # lever arms and delay, in `axes` [SI]
    axes: str
    dropped: CoefficientVector  # what is left out, as it was [SI]
    counts: Mapping[str, Counts]  # how raw counts become SI, for the triads whose log was in counts
    # the matrices as functions of temperature, where they are; `model` is then that at the
    # reference temperature
    temperature: TemperatureTerms | None = None

    def statement(self) -> list[str]:
        """Return what every exported file says of itself, line by line."""
        turned = "" if self.axes == OWN_AXES else f", turned from the result's {OWN_AXES}"
        signs = "Signs: a bias is measured minus true; at rest the axis that points up reads +1 g."
        lines = about(self.result, f"Axes: {self.axes}{turned}", signs)
        lines += _beside(self.result.diagnostics)
        if len(self.dropped):
            lines += ["LOST, because it was dropped on request (the numbers are in SI units):"]
            lines += [
                f"  {c.name} = {value!r} {c.unit}"
                for c, value in zip(
                    self.dropped.layout.coefficients, self.dropped.values.tolist(), strict=True
                )
            ]
        return lines


def about(result: Result, axes: str, signs: str = "") -> list[str]:
    """Return what every exported file says of its result, line by line.

    `axes`, `signs`: in which axes its numbers are, and in which signs.
    """
    made = result.provenance
    given = {key: result.instrument.get(key) for key in ("name", "serial")}
    instrument = ", ".join(f"{key} {value}" for key, value in given.items() if value)
    lines = [
        f"{EXPORTED.decode()} {(made.get('versions') or {}).get('foucault', '')}".rstrip()
        + f", procedure {result.procedure}"
        + (f", {made['created']}" if made.get("created") else "")
        + ".",
        *_log(made.get("input")),
        f"Instrument: {instrument or 'not named'}. Verdict: {result.verdict.level}.",
        f"Model: {result.equation}",
        *([signs] if signs else []),
        f"{axes}. Body axes of the result: {result.gauge}.",
        *(f"Valid for: {words}." for words in _validity(result.validity)),
    ]
    return [" ".join(line.split()) for line in lines]


def _log(read: Any) -> list[str]:
    """Say which file was calibrated, in so far as it is known."""
    file, digest = (
        read.get(key) if isinstance(read, Mapping) else None for key in ("file", "sha256")
    )
    if not isinstance(file, str):
        return []
    return [f"Log: {file}" + (f", SHA-256 {digest[:16]}..." if isinstance(digest, str) else "")]


def _beside(known: Mapping[str, Any]) -> list[str]:
    """Say how a slave is mounted and how late its master: no correction of readings has that."""
    mounting = known.get("mounting")
    if not isinstance(mounting, Mapping):  # on faces, it is how each axis was clamped
        return []
    try:
        rows = ", ".join(f"({', '.join(f'{x:.9f}' for x in row)})" for row in mounting["C_ms"])
        late = f"{1e3 * known['delay']['used']:.3f} ms late."
    except (KeyError, TypeError, ValueError):
        problem = "diagnostics.mounting and diagnostics.delay are not numbers"
        raise error("result.invalid", file=RESULT_FILE, problems=problem) from None
    return [
        f"Beside it, and no part of the correction: x_master = C_ms x_slave, {OWN_AXES} both, C_ms "
        f"= ({rows}); messages of the master come {late}"
    ]


def request(
    result: Result,
    receiver: str,
    can: Sequence[str],
    *,
    axes: str = OWN_AXES,
    drop: Iterable[str] = (),
    log: LogDescription | None = None,
    force: bool = False,
) -> Request:
    """Check that a result can be exported, and bring it into the axes of the receiver.

    `axes`: key of `AXES`: the axes of its readings; `drop`: coefficients or groups that may be
    left out; `log` or None: how the calibrated log was read, for raw counts.
    """
    vector = of_sensors(result.coefficients)
    usable(result, force)
    known_axes(axes)
    drop = tuple(drop)
    dropped = _dropped(vector, drop)
    kept = vector.with_values(dict.fromkeys(dropped.names, 0.0))
    lost = [
        name
        for name, value in zip(kept.names, kept.values, strict=True)
        if value != 0 and family(name) not in can
    ]
    if lost:
        families = list(dict.fromkeys(family(name) for name in lost))
        raise error(
            "export.inexpressible",
            receiver=receiver,
            terms=", ".join(lost),
            options=" ".join(f"--drop {family}" for family in families),
        )
    C_sb = AXES[axes]
    model = in_axes(ImuModel.from_coefficients(of_one_sample(kept)), C_sb)
    size = SizeEffect.of(kept).rotated(C_sb)
    size = replace(size, arms=np.abs(C_sb) @ size.arms)  # the accelerometers change places
    terms = None
    if result.temperature is not None:
        gone = tuple({ALL.names[i] for name in drop for i in ALL.group(name)})
        terms = TemperatureTerms.of(result.temperature, gone, lambda m: in_axes(m, C_sb))
    return Request(result, model, size, axes, dropped, _counts(log, C_sb), terms)


def usable(result: Result, force: bool) -> None:
    """Refuse a result with unknown coefficients, and an unusable one without `force`."""
    if not np.isfinite(of_sensors(result.coefficients).values).all():
        raise error("export.not_finite", procedure=result.procedure)
    if result.verdict.level is Level.UNUSABLE and not force:
        reasons = " ".join(result.verdict.reasons) or "No reason is given."
        raise error("export.unusable", reasons=reasons)
    result.numbers()


def known_axes(axes: str) -> None:
    """Refuse a name of axes that is none of `AXES`."""
    if axes not in AXES:
        hint = suggestion(axes, AXES)
        raise error("export.axes", given=axes, hint=hint, allowed=", ".join(AXES))


def in_axes(model: ImuModel, C_sb: FloatArray) -> ImuModel:
    """Express readings and true values in other axes, each along one of the old.

    `model`: the model in axes b [SI]; `C_sb` (3, 3): rotation to the other axes, x_s = C_sb @
    x_b, one of `AXES` [1].

    Asymmetry and the cubic term of a gyro are those of one output, so that only axes along the old
    ones can have them; where the sense of an axis changes, so does that of its asymmetry.
    """
    turned = vars(model.rotated(C_sb))
    senses = {"gyro_cubic": np.abs(C_sb)}  # an odd term: the sense of an axis is in it twice
    return ImuModel(**{n: np.tensordot(senses.get(n, C_sb), x, 1) for n, x in turned.items()})


def _dropped(vector: CoefficientVector, drop: Iterable[str]) -> CoefficientVector:
    """Return the coefficients to leave out; what the result does not have is no mistake."""
    wanted: set[str] = set()
    for name in drop:
        wanted |= {ALL.names[i] for i in ALL.group(name)}  # raises with a suggestion
    names = [
        name
        for name, value in zip(vector.names, vector.values, strict=True)
        if name in wanted and value != 0
    ]
    return CoefficientVector(
        vector.layout.subset(names), np.array([vector.value(name) for name in names])
    )


def _counts(log: LogDescription | None, C_sb: FloatArray) -> dict[str, Counts]:
    if log is None:
        return {}
    out = {}
    for name in ("accel", "gyro"):
        block: Triad | None = getattr(log, name)
        if block is None or block.scale is None or block.columns is None:
            continue
        zero, factor = block.conversion()
        columns = [str(column) for column in block.columns]
        flip = np.array([-1.0 if column.startswith("-") else 1.0 for column in columns])
        at = np.argmax(np.abs(C_sb), axis=1)
        sign = C_sb[np.arange(3), at]
        out[name] = Counts(
            tuple(columns[i].removeprefix("-") for i in at),
            zero[at] + 0.0,
            (factor * flip)[at] * sign,
        )
    return out


def _validity(validity: Mapping[str, Any]) -> list[str]:
    out = []
    for key, what, unit in (
        ("accel", "specific force", "m/s^2"),
        ("gyro", "angular rate", "rad/s"),
        ("temperature", "temperature", "K"),
    ):
        limits = validity.get(key)
        if limits is not None and None not in limits:
            out.append(f"{what} of {limits[0]:.6g} to {limits[1]:.6g} {unit}")
    return out


# -- What exports of coefficients that change with temperature share: their terms, as matrices ---


@dataclass(frozen=True)
class TemperatureTerms:
    """Matrices as sums over functions of temperature, ``A(T) = sum of A_k phi_k(T)``."""

    functions: TemperatureModel  # phi_k, and where they hold [K]
    # A_k: the matrices that phi_k multiplies, in the axes of the export [SI per unit of phi_k]
    terms: tuple[ImuModel, ...]

    @classmethod
    def of(
        cls,
        functions: TemperatureModel,
        dropped: tuple[str, ...],
        turned: Callable[[ImuModel], ImuModel],
    ) -> TemperatureTerms:
        """Return the terms without the coefficients `dropped`, turned into other axes.

        `functions`: coefficients as functions of temperature [SI]; `turned`: what brings a model
        into the axes of the export, it is linear in all matrices.
        """
        functions = without(functions, tuple(n for n in dropped if n in functions.layout))
        out = []
        for k, column in enumerate(functions.weights.T):
            vector = of_one_sample(CoefficientVector(functions.layout, column))
            term = turned(ImuModel.from_coefficients(vector))
            if k > 0 and not functions.knots.size:  # the identity stands in the first term only
                term = replace(
                    term, accel_matrix=term.accel_matrix - np.eye(3),
                    gyro_matrix=term.gyro_matrix - np.eye(3),
                )  # fmt: skip
            out.append(term)
        return cls(functions, tuple(out))

    def block(self, name: str) -> FloatArray:
        """Return the terms of one matrix, shape (p, ...) [SI per unit of phi_k]."""
        return np.array([getattr(term, name) for term in self.terms])

    @property
    def pattern(self) -> ImuModel:
        """A model in which all is zero that is zero at every temperature, and nothing else."""
        names = [f.name for f in fields(ImuModel)]
        return ImuModel(**{n: np.abs(self.block(n)).sum(axis=0) for n in names})

    def statement(self) -> str:
        """Say what the functions are, for people."""
        f = self.functions
        if f.knots.size:
            return (
                f"Coefficients change with temperature, piecewise linear between {f.knots.size} "
                f"knots from {f.knots[0]:.2f} K to {f.knots[-1]:.2f} K."
            )
        return (
            f"Coefficients change with temperature T [K], as powers 0 to {len(self.terms) - 1} of "
            f"T - {f.reference:.2f} K."
        )


# -- Numbers as text that reads back to the same bits --------------------------------------------


def inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse of `matrix`, shape (3, 3) [1]."""
    return np.asarray(np.linalg.inv(matrix), np.float64)


def number(value: float) -> str:
    """Write `value` [SI] with a point: YAML 1.1 takes 1e-05 for text, 1.0e-05 for a number."""
    text = repr(float(value) + 0.0)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def row(values: FloatArray) -> str:
    """Write `values`, shape (n,) [SI], separated by commas."""
    return ", ".join(number(v) for v in values)


def rows(matrix: FloatArray, opening: str, closing: str, indent: str = "    ") -> str:
    """Write `matrix`, shape (m, n) [SI], one row per line between brackets."""
    lines = [f"{indent}{opening}{row(line)}{closing}" for line in matrix]
    return ",\n".join(lines)


def tensor(values: FloatArray, opening: str, closing: str) -> str:
    """Write `values`, shape (l, m, n) [SI], one matrix after the other between brackets."""
    parts = [f"    {opening}\n{rows(m, opening, closing, '        ')}" for m in values]
    return ",\n".join(f"{part},\n    {closing}" for part in parts)


def nested(values: FloatArray, opening: str, closing: str) -> str:
    """Write `values`, shape (n,), (m, n) or (l, m, n) [SI], between brackets."""
    if values.ndim == 1:
        return f"{opening}{row(values)}{closing}"
    lines = (rows if values.ndim == 2 else tensor)(values, opening, closing)
    return f"{opening}\n{lines},\n{closing}"


# -- Code of other programs: for each module of `export` a file of the pieces that it joins ------


def pieces(name: str) -> dict[str, str]:
    """Return the pieces of a file, each below a line of its name: ``==== next``."""
    text = (Path(__file__).parent / "templates" / f"{name}.txt").read_text(encoding="utf-8")
    parts = re.split(r"^==== (\w+)\n", text, flags=re.MULTILINE)[1:]
    return {key: code.removesuffix("\n") for key, code in zip(parts[::2], parts[1::2], strict=True)}
