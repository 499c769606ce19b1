"""The spins of a session as a linear model of the engine, and what is wrong with them.

A spin whose phase is eliminated (`estimate.spin`) is a handful of white rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import Layout
from foucault.detect.steady import Spin
from foucault.errors import error
from foucault.estimate.spin import Solved, floor, solve
from foucault.infer import mixed
from foucault.infer.mixed import NOISE_BASIS, Linearisation, Source
from foucault.models.imu import LAYOUT
from foucault.models.left_out import NONE, Change
from foucault.models.noise import ImuNoise, wander
from foucault.models.spin import GRIP, moved
from foucault.units import plain

LITTLE = 1e-3, 1e-11
"""Least information of a row: of the usual size of what it says, and of the largest row [1]."""

USUAL = {"accel.bias": 0.5, "gyro.bias": 0.02, "accel.quadratic": 1e-4, "gyro.g_sensitivity": 1e-4}
"""Usual sizes of coefficients, 0.01 where nothing is said [SI]."""


@dataclass(frozen=True)
class Rows:
    """White rows that hold all that a spin says."""

    spin: int  # its number [1]
    jacobian: FloatArray  # (d, u) of its own unknowns [1 / SI]
    residuals: FloatArray  # (d,) [1]
    # accel, gyro: (d,) shares of the noise of both triads in the variance of each, the phase's the
    # rest [1]
    accel: FloatArray
    gyro: FloatArray
    by_gradient: FloatArray  # (d, u) rows by the gradient [SI]


def rows_of(at: Solved) -> tuple[Rows, ...]:
    """Return the rows of every spin: directions of its unknowns that it shows, one by one.

    They are turned so that each is of the accelerometers or of the gyros as far as may be.
    """
    sizes = np.array([USUAL.get(n.rpartition(".")[0], 0.01) for n in at.names] + [0.01] * GRIP)
    out = []
    for k, one in enumerate(at.each):
        N = one.information * np.outer(sizes, sizes)
        value, axes = np.linalg.eigh((N + N.T) / 2)
        kept = value > max(LITTLE[0], LITTLE[1] * value[-1])
        half = axes[:, kept] / np.sqrt(value[kept])
        shares = []
        for triad in (slice(0, 3), slice(3, 6)):
            flat = one.pull[:, triad].reshape(-1, len(sizes)) * sizes
            shares.append(half.T @ (flat.T @ flat) @ half)
        turn = np.linalg.eigh(shares[0])[1]
        accel, gyro = (np.einsum("ij,ik,kj->j", turn, s, turn) for s in shares)
        accel = np.clip(accel, 0.0, 1.0)
        back = (half @ turn).T * sizes
        J = (axes[:, kept] * np.sqrt(value[kept]) @ turn).T / sizes
        out.append(Rows(k, J, back @ one.gradient, accel, np.clip(gyro, 0.0, 1 - accel), back))
    return tuple(out)


@dataclass(frozen=True)
class SpinModel:
    """The linear model that a session states: a state is all unknowns, about the point found."""

    solved: Solved
    rows: tuple[Rows, ...]
    noise: ImuNoise | None  # as declared [SI]
    repeatability: bool
    # Terms that were taken off the readings before: of the rows they are a part again [SI].
    taken: Change = NONE

    @property
    def layout(self) -> Layout:
        """The coefficients."""
        return LAYOUT.subset(self.solved.names)

    @cached_property
    def start(self) -> FloatArray:
        """All unknowns at the point, shape (m,): coefficients, and what is added to grips."""
        at = self.solved
        values = at.point.model.coefficients(at.names).values
        return np.append(values, np.zeros(GRIP * len(at.point.grips)))

    @cached_property
    def spin(self) -> IntArray:
        """Number of the spin of every row, shape (n,)."""
        return np.repeat([r.spin for r in self.rows], [len(r.residuals) for r in self.rows])

    @cached_property
    def kinds(self) -> dict[str, BoolArray]:
        """Rows by what is the most of their noise, shape (n, 1)."""
        first = np.concatenate([r.accel > 0.5 for r in self.rows])[:, None]
        return {"accelerometers": first, "gyros": ~first}

    def retract(self, state: FloatArray, step: FloatArray) -> FloatArray:
        """Add `step` (m,) to a `state` (m,) [SI]."""
        return state + step

    def values(self, state: FloatArray) -> FloatArray:
        """Return the coefficients (p,) of a `state` (m,) [SI]."""
        return state[: len(self.solved.names)]

    @cached_property
    def _at_start(self) -> tuple[FloatArray, FloatArray, tuple[Source, ...]]:
        at = self.solved
        J = np.zeros((len(self.spin), 1, at.unknowns))
        for r in self.rows:
            J[np.flatnonzero(self.spin == r.spin)[:, None], 0, at.own(r.spin)] = r.jacobian
        z = np.concatenate([r.residuals for r in self.rows])
        if self.taken is not NONE:
            z += self.changed(self.taken)[:, 0]
        return z, J, self._sources(J)

    def linearise(self, state: FloatArray) -> Linearisation:
        """Compare the rows with those at `state` (m,) [SI]."""
        z, J, sources = self._at_start
        at, p = self.solved, len(self.solved.names)
        away = state - self.start
        count = len(at.point.grips)
        known = np.zeros((2 * count, at.unknowns))
        value = np.empty(2 * count)
        for m, grip in enumerate(at.point.grips):
            for k in range(2):
                column = p + GRIP * m + 5 + k
                known[2 * m + k, column] = 1 / at.level_sd
                value[2 * m + k] = -(grip.level[k] + away[column]) / at.level_sd
        left = z - J[:, 0] @ away
        named = ("azimuth of the axis",) * len(value)
        return Linearisation(left[:, None], J, sources, (value, known), named)

    def changed(self, by: Change) -> FloatArray:
        """Return what something put into the readings of all spins adds to the rows, (n, 1) [1]."""
        at, out = self.solved, []
        for r, one, added in zip(self.rows, at.each, self._of_each(by), strict=True):
            if by.gravity or by.latitude:
                added -= self._elsewhere(r.spin, by)
            added /= at.point.sizes[r.spin].sd
            out.append(r.by_gradient @ np.einsum("nku,nk->u", one.pull, added))
        return np.concatenate(out)[:, None]

    def _elsewhere(self, k: int, by: Change) -> FloatArray:
        """Return what readings of spin `k` would be at another place less what they are, (n, 6)."""
        at, site = self.solved, self.solved.site
        north = (site.latitude or 0.0) + by.latitude  # unknown: no rate along up
        there = replace(site, gravity=site.gravity + by.gravity, latitude=north)
        spin, point = at.spins[k], at.point
        said = []
        for place in (there, site):
            one = moved(
                point.grips[spin.mounting], point.paths[k], place, spin.shrunk(point.paths[k][:, 1])
            )
            said.append(np.column_stack(point.model.measure(one.f, one.w)))
        return np.asarray(said[0] - said[1])

    @cached_property
    def motion(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time (n,) [s], true specific force and rate (n, 3) [SI] of all readings."""
        at = self.solved
        each = [moved(at.point.grips[s.mounting], path, at.site, s.shrunk(path[:, 1]))
                for s, path in zip(at.spins, at.point.paths, strict=True)]  # fmt: skip
        return (np.concatenate([s.time for s in at.spins]), np.concatenate([m.f for m in each]),
                np.concatenate([m.w for m in each]))  # fmt: skip

    def without(self, taken: Change) -> SpinModel:
        """Return the model of the readings without terms of the instrument [SI].

        Along the wander of a tool a term is taken for noise, sample by sample. Once: noise is
        then a quarter too large at most, and further looks spoiled some results.
        """
        at = self.solved
        spins = tuple(
            replace(s, readings=s.readings - some)
            for s, some in zip(at.spins, self._of_each(taken), strict=True)
        )
        solved = solve(spins, at.point, at.names, at.site, self.noise)
        return replace(self, solved=solved, rows=rows_of(solved), taken=taken)

    def _of_each(self, by: Change) -> list[FloatArray]:
        """Return what a change adds to the readings of each spin, (n, 6) [SI]."""
        ends = np.cumsum([len(s.time) for s in self.solved.spins])
        out = np.zeros((ends[-1], 6))
        if by.accel is not None:
            out[:, :3] = by.accel
        if by.gyro is not None:
            out[:, 3:] = by.gyro
        return np.split(out, ends[:-1])

    @cached_property
    def vibration(self) -> FloatArray:
        """Share of the variance of the triads that no declared noise is, (spins, 2) [1]."""
        at = self.solved
        if self.noise is None:
            return np.zeros((len(at.spins), 2))
        parts = [
            1 - (floor(s, self.noise) / z.sd) ** 2
            for s, z in zip(at.spins, at.point.sizes, strict=True)
        ]
        return np.asarray(np.clip(np.array(parts).reshape(-1, 2, 3).mean(axis=2), 0.0, 1.0))

    def _sources(self, J: FloatArray) -> tuple[Source, ...]:
        accel = np.concatenate([r.accel for r in self.rows])
        gyro = np.concatenate([r.gyro for r in self.rows])
        shaken = self.vibration[self.spin]
        how = NOISE_BASIS["measured" if self.noise is None else "declared"]
        words = "scatter of the samples of a spin beyond the noise"
        parts = {
            "accelerometer noise": (accel * (1 - shaken[:, 0]), True, *how),
            "gyro noise": (gyro * (1 - shaken[:, 1]), True, *how),
            "vibration": (accel * shaken[:, 0] + gyro * shaken[:, 1], False, "A", words),
            "wander of the rate": (1 - accel - gyro, False, "A", "most likely for the readings"),
        }
        out = [
            Source(name, np.sqrt(np.maximum(share, 0.0))[:, None, None], noise=noise, type=kind,
                   basis=basis)
            for name, (share, noise, kind, basis) in parts.items()
        ]  # fmt: skip
        if self.solved.site.latitude is None:
            out.append(Source("unknown Earth rate", shared=self.changed(ANYWHERE)[:, :, None],
                              basis="any latitude is as likely"))  # fmt: skip
        if self.repeatability:
            out += [mixed.scatter(name, np.sqrt(share)[:, None, None])
                    for name, share in zip(SCATTER, (accel, gyro), strict=True)]  # fmt: skip
        return (*out, *self._slow(J))

    def _slow(self, J: FloatArray) -> tuple[Source, ...]:
        """Return the drift of the biases from spin to spin, as the declared noise has it."""
        if self.noise is None:
            return ()
        spins, out = self.solved.spins, []
        middle = np.array([s.time.mean() for s in spins])
        length = np.array([float(np.ptp(s.time)) for s in spins])
        for family, what, triad in (("accel", "accelerometer", self.noise.accel),
                                    ("gyro", "gyro", self.noise.gyro)):  # fmt: skip
            if not (triad.bias_instability or triad.random_walk):
                continue
            root = mixed.root(wander(triad, middle, length))
            bias = [LAYOUT.subset(self.solved.names).index(f"{family}.bias.{a}") for a in "xyz"]
            shared = mixed.tied(J[:, :, bias], root[self.spin])
            out.append(Source(f"{what} bias instability", shared=shared, noise=True,
                              basis="noise as declared in the campaign"))  # fmt: skip
        return tuple(out)


ANYWHERE = Change(latitude=float(np.arcsin(1 / np.sqrt(3))))
"""One sd of the Earth's rate along up where no latitude is known, as from the equator [rad]."""

SCATTER = (
    "scatter of the accelerometers beyond a spin's samples",
    "scatter of the gyros beyond a spin's samples",
)
"""Sources that are found where the samples of a spin say too little."""


# -- what is judged --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Slip:
    """How far one spin is from its mounting."""

    spin: int  # its number [1]
    ratio: float  # of the shift over its sd [1]
    arm: float  # by how much the lever arm differs [m]
    axis: float  # by how much the axis does [rad]


def slips(model: SpinModel) -> list[Slip]:
    """Return how far the grip of every spin is from that of its mounting.

    By what it would explain of what is left, were its grip free, against what then is left: an
    axis that sways is another one in every spin, and none of them slipped.
    """
    from scipy.special import fdtrc, ndtri

    out, p, size = [], len(model.solved.names), np.array([1e-3, 1e-3, 1e-3, 1e-4, 1e-4])
    at = model.linearise(model.start)
    assert at.known is not None
    Q = np.linalg.qr(np.concatenate([at.jacobian[:, 0], at.known[1]]))[0]
    rest = np.append(at.residuals[:, 0], at.known[0])
    rest = rest - Q @ (Q.T @ rest)
    dof = len(model.spin) - model.solved.unknowns
    for r in model.rows:
        free = np.zeros((len(rest), 5))
        free[: len(model.spin)][model.spin == r.spin] = r.jacobian[:, p : p + 5] * size
        x, _, rank, _ = np.linalg.lstsq(free - Q @ (Q.T @ free), rest, rcond=1e-3)
        gained = float(rest @ (free - Q @ (Q.T @ free)) @ x)
        F = gained / rank / max((float(rest @ rest) - gained) / (dof - rank), 1e-300)
        ratio = float(-ndtri(max(fdtrc(rank, dof - rank, F) / 2, 1e-300)))
        x = x * size
        out.append(Slip(r.spin, ratio, float(np.hypot(*x[3:5])), float(np.hypot(*x[:2]))))
    return out


# -- what people do wrong --------------------------------------------------------------------------


def require_spread(spins: tuple[Spin, ...], axes: list[FloatArray]) -> None:
    """Refuse what leaves something unknown; `axes`: of the mountings, (3,) each [1]."""
    spread = np.linalg.svd(np.array(axes), compute_uv=False)
    if len(axes) < 3 or spread[2] < LEAN:
        raise error("spun.mountings", count=len(axes), spins=len(spins))
    speeds = np.abs([s.rate for s in spins])
    if speeds.max() < SPAN * speeds.min():
        raise error(
            "spun.one_speed", slowest=plain(speeds.min(), 3), fastest=plain(speeds.max(), 3)
        )
    for m in range(len(axes)):
        if len({s.rate > 0 for s in spins if s.mounting == m}) < 2:
            raise error("spun.one_sense", mounting=m + 1)


LEAN = 0.3  # Least singular value of the axes of the mountings: about 17 deg out of one plane [1].
SPAN = 1.25  # Fastest over slowest spin from which on lever arms are told from biases [1].
