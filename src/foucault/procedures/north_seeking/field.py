"""What the fix of a north seeker does not estimate and counts with, as its calibration does.

Terms of the instrument are alike in all set-ups of a file; each set-up takes them with its own
attitude and stops. Where the latitude is known a set-up has four numbers and three unknowns: one is
left to test with. With L L' the covariance of the noise, n the direction of ``L^-1`` times the four
numbers that no angle explains, B the columns of all groups, calibration and latitude among them::

    z_i = n_i' L_i^-1 r_i   Z_i = n_i' L_i^-1 B_i   u = (I + Z'Z)^-1 Z'z   V = (I + Z'Z)^-1 Z'Z

Of many set-ups the products are enough, so that they are taken block by block.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.errors import Finding, finding
from foucault.estimate.north import LATITUDE, Fixes, Known, levelled
from foucault.estimate.north_reduction import INDEXING, Pairs
from foucault.infer.left_out import (
    MATTERS,
    ROUNDS,
    Judgement,
    Seen,
    detectable,
    farthest,
    guilty,
    joined,
    seen_of,
)
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import (
    GRAVITY,
    Change,
    Motion,
    Sizes,
    changes,
    in_words,
    table,
    terms,
)
from foucault.models.north_seeker import Compensation, Dwells, attitude, earth_rate_b, up_b
from foucault.procedures.north_seeking.counted import added, felt, moved, on_case

CALIBRATION, SCATTER = "errors of the calibration", "scatter of the set-ups"

HOUR = 3600.0
"""A drift is of one size over this time at least, for one set-up takes minutes [s]."""

MISFIT = 1e-5
"""A set-up whose accelerometers scatter as rarely as that may be due to terms of theirs [1]."""

LISTED = 3
"""Groups that a sentence names [1]."""


def words_of(group: str) -> str:
    """Return what a budget calls a group."""
    known = table().groups
    return known[group].what if group in known else group


def whole_sizes(sizes: Sizes, site: Site) -> Sizes:
    """Return sizes [SI] with that of gravity."""
    return {**sizes, GRAVITY: (site.gravity_sd, "standard uncertainty of local gravity")}


@dataclass(frozen=True)
class Left:
    """What set-ups are off by that nobody estimates."""

    pairs: Pairs  # of the readings alone [SI]
    known: Known
    compensation: Compensation
    motion: Motion  # of the readings at the attitudes that were found
    angles: FloatArray  # (m, 4) these attitudes, and latitudes [rad]
    sizes: Sizes  # of the instrument and of gravity [SI]
    names: Mapping[str, tuple[str, ...]]  # group -> its terms
    felt: Mapping[str, list[int]]  # group -> the c of its terms that do something [1]
    columns: Mapping[str, FloatArray]  # group -> (m, 4, c) what one size of these does [SI]

    @classmethod
    def of(
        cls, dwells: Dwells, pairs: Pairs, angles: FloatArray, known: Known,
        compensation: Compensation, site: Site, sizes: Sizes, span: tuple[float, float],
    ) -> Left:  # fmt: skip
        """Take all terms at solutions `angles` (m, 4) [rad]; `sizes` as `counted.beside` has them.

        `span`: begin and end of the whole file [s].
        """
        angles = np.where(np.isfinite(angles), angles, 0.0)
        w_b, f_b = _truth(angles, known)
        motion = moved(dwells, f_b, w_b)
        motion = motion._replace(begin=span[0], end=max(span[1], span[0] + HOUR))
        whole = whole_sizes(sizes, site)
        some = terms(compensation.coefficients.names, replace(site, latitude=None), whole)
        columns, names = dict[str, FloatArray](), dict[str, tuple[str, ...]]()
        every = dict[str, list[int]]()
        for group, each in groupby(some, key=lambda term: term.group):
            own = [*each]
            names[group] = tuple(term.name for term in own)
            every[group] = [0] if group == GRAVITY else [
                k for k, term in enumerate(own) if felt(term, dwells)
            ]  # fmt: skip
            if group == GRAVITY:
                more = f_b * (1 + own[0].size / np.reshape(known.gravity, (-1, 1)))
                heavier = compensation.predict(w_b, more) - compensation.predict(w_b, f_b)
                columns[group] = heavier[:, :, None]
                continue
            made: list[Change] = []
            if every[group]:
                at = motion
                if group.startswith("gyro") or not on_case(dwells):
                    n = len(dwells)
                    at = at._replace(time=at.time[:n], f_b=at.f_b[:n], w_ib_b=at.w_ib_b[:n])
                made = [*changes([own[k] for k in every[group]], ImuModel(), at)]
            columns[group] = added(pairs, dwells, made)
        return cls(pairs, known, compensation, motion, angles, whole, names, every, columns)

    def counted(self, times: Mapping[str, float]) -> tuple[Pairs, Known]:
        """Return the set-ups with the covariance of all groups, and the place as it counts.

        `times`: group -> how many sizes it has, where that is not one [1].
        """
        parts = {words_of(g): times.get(g, 1.0) * B for g, B in self.columns.items()}
        more = times.get(CALIBRATION, 1.0)
        if more > 1.0:
            beyond = np.sqrt(more**2 - 1) * self._calibration()
            parts[f"{CALIBRATION} beyond what it says"] = beyond
        wider = self.known.latitude_sd * times.get(LATITUDE, 1.0)
        return replace(self.pairs, roots=parts), replace(self.known, latitude_sd=wider)

    def _calibration(self) -> FloatArray:
        """Return what one sd of the calibration does to the four numbers, (m, 4, c) [SI]."""
        cov = self.compensation.coefficients.cov
        if cov is None or not len(cov):
            return np.zeros((len(self.pairs), 4, 0))
        size, axes = np.linalg.eigh(cov)
        root = axes * np.sqrt(np.maximum(size, 0.0))
        return np.asarray(self.compensation.slopes(*_truth(self.angles, self.known)) @ root)

    def products(self, good: BoolArray) -> Products:
        """Return the one number of each set-up that no angle explains, in products.

        `good` (m,): which are solved.
        """
        known, compensation = self.known, self.compensation
        columns = {**self.columns, CALIBRATION: self._calibration()}
        each_own = isinstance(known.latitude_sd, np.ndarray)  # of each set-up by itself: noise
        wide = known.latitude is not None and not each_own and bool(known.latitude_sd)
        groups = {g: len(self.names.get(g, B[0, 0])) for g, B in columns.items()}
        groups |= {LATITUDE: 1} if wide else {}
        size, at = 1, [0]  # in the order of all terms; of those that do nothing it is nothing
        for group, count in groups.items():
            at += [size + k for k in self.felt.get(group, range(count))]
            size += count
        if known.latitude is None or not good.any():
            return Products(np.zeros((size, size)), 0, groups)
        pairs, T = levelled(self.pairs, known, compensation)
        angles = np.column_stack([self.angles[:, :3], np.full(len(good), known.latitude)])
        J, latitude = self._slopes(angles)
        cov = pairs.cov
        if each_own:
            own = latitude * np.reshape(known.latitude_sd, (-1, 1, 1))
            cov = cov + own @ np.swapaxes(own, 1, 2)
        # What is at right angles to the slopes: their cofactors, over the sd of what that says.
        rows = ([1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2])
        across = np.stack([(-1) ** i * _det(J[:, some]) for i, some in enumerate(rows)], 1)
        sd = np.sqrt(np.einsum("ni,nij,nj->n", across, cov, across, optimize=True))
        back = (across / np.maximum(sd, 1e-300)[:, None])[good]
        left = (pairs.values - compensation.predict(*_truth(angles, known)))[good]
        B = np.concatenate([*columns.values()], axis=2)[good]
        made = [left[:, :, None], B if T is None else T[good] @ B]
        made += [(latitude * known.latitude_sd)[good]] if wide else []
        each = (back[:, None] @ np.concatenate(made, axis=2))[:, 0]
        sums = np.zeros((size, size))
        sums[np.ix_(at, at)] = each.T @ each
        return Products(sums, len(each), groups)

    def _slopes(self, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slopes of the four numbers at `angles` [rad]: of attitude, latitude (m, 4, 3|1).

        Of the attitude against rotations about East, North and Up, see `kernels.north_seeking`.
        """
        model = self.compensation.model
        C = attitude(*angles[:, :3].T)
        east, north, up = (C[:, :, i] for i in range(3))
        sin, cos = (EARTH_RATE * f(angles[:, 3:]) for f in (np.sin, np.cos))
        g = np.reshape(self.known.gravity, (-1, 1))
        J = np.zeros((len(angles), 4, 3))
        rates = (up * cos - north * sin, east * sin, -east * cos)
        J[:, :2] = np.stack([w @ model.gyro_matrix[:2].T for w in rates], 2)
        forces = (-g * north, g * east)
        J[:, 2:, :2] = np.stack([f @ model.accel_matrix[:2].T for f in forces], 2)
        latitude = J[:, :, :1].copy()
        latitude[:, 2:] = 0.0
        return J, latitude


def _det(A: FloatArray) -> FloatArray:
    """Return the determinants of matrices (m, 3, 3), shape (m,)."""
    return np.asarray(np.einsum("ni,ni->n", A[:, 0], np.cross(A[:, 1], A[:, 2])))


def _truth(angles: FloatArray, known: Known) -> tuple[FloatArray, FloatArray]:
    """Return rate and specific force in the case (m, 3) [SI] at `angles` (m, 4) [rad]."""
    up = up_b(angles[:, 1], angles[:, 2])
    return earth_rate_b(*angles.T), np.reshape(known.gravity, (-1, 1)) * up


@dataclass(frozen=True)
class Products:
    """Sums over set-ups of products of the one number z of each, and of what groups do to it, Z."""

    sums: FloatArray  # (1 + c, 1 + c) of z, and of c terms [1]
    count: int  # set-ups [1]
    groups: Mapping[str, int]  # group -> how many terms it has [1]

    def __add__(self, more: Products) -> Products:
        groups = self.groups if len(self.groups) >= len(more.groups) else more.groups
        return Products(self.sums + more.sums, self.count + more.count, groups)

    def of(self, groups: Collection[str]) -> Products:
        """Return those of some groups, and of calibration and place."""
        keep, at = [0], 1
        for name, size in self.groups.items():
            if name in groups or name in (CALIBRATION, LATITUDE):
                keep += range(at, at + size)
            at += size
        some = {n: k for n, k in self.groups.items() if n in (*groups, CALIBRATION, LATITUDE)}
        return Products(self.sums[np.ix_(keep, keep)], self.count, some)

    def judged(self) -> tuple[dict[str, float], dict[str, Seen], list[dict[str, float]]]:
        """Test every group; enlarge what is contradicted.

        Set-ups that scatter as nothing of it explains are tested by their scatter: their checks say
        how large that is. Returns how many sizes groups have, every group as it was tested first,
        and who was named.
        """
        times, named, first = dict[str, float](), list[dict[str, float]](), dict[str, Seen]()
        scattering = 1.0
        for _ in range(ROUNDS):
            seen = self._tested(times, scattering)
            first, suspects = first or seen, guilty(seen)
            blamed = {n: s for n, s in suspects.items() if s.kind != "scatter"}
            if not blamed and scattering == 1.0 and suspects:
                scattering, first = suspects[SCATTER].k, {}
                continue
            if not blamed:
                break
            times |= {n: times.get(n, 1.0) * s.k for n, s in blamed.items()}
            order = sorted(blamed, key=lambda name: -blamed[name].gain)
            named.append({name: blamed[name].k for name in order})
        return times, first, named

    def _tested(self, times: Mapping[str, float], scattering: float) -> dict[str, Seen]:
        """Test groups of so many sizes, and whether set-ups scatter by more than so much [1]."""
        from scipy.special import chdtrc

        each = [np.full(size, times.get(g, 1.0)) for g, size in self.groups.items()]
        scale = np.concatenate([np.ones(1), *each]) / scattering
        sums = scale[:, None] * self.sums * scale
        square, v, A = float(sums[0, 0]), sums[1:, 0], sums[1:, 1:]
        inner = np.eye(len(A)) + A
        u, V = np.linalg.solve(inner, v), np.linalg.solve(inner, A)
        out, at = dict[str, Seen](), 0
        for group, size in self.groups.items():
            own = slice(at, at := at + size)
            if size:
                kind = "prior" if group in (CALIBRATION, LATITUDE) else "source"
                out[group] = seen_of(kind, u[own], (V[own, own] + V[own, own].T) / 2)  # type: ignore[arg-type]
        if (n := self.count) > 1:
            total = square - float(v @ u)
            mean, none = total / n, np.zeros((1, 1))
            gain = n * (mean - 1.0 - np.log(max(mean, 1e-300))) if mean > 1.0 else 0.0
            out[SCATTER] = Seen("scatter", none[0], none, total, n, float(chdtrc(n, total)),
                                max(mean, 1.0) ** 0.5, gain)  # fmt: skip
        return out


def judgement(
    known: Known, sizes: Sizes, names: Mapping[str, tuple[str, ...]], fixes: Fixes,
    first: Mapping[str, Seen], named: list[dict[str, float]], index_sd: float,
    assumed: Mapping[str, str],
) -> Judgement:  # fmt: skip
    """Say what was made of every group, and what it is of the heading of `fixes` [rad].

    `sizes`: of each group [SI]; `names`: group -> its terms; `named`: sets of groups and how many
    times they were enlarged [1]; `index_sd`: of every index angle [rad]; `assumed`: source ->
    basis, where nobody said its size.
    """
    rig = {INDEXING: index_sd, LATITUDE: 0.0 if known.latitude is None else
           float(np.max(known.latitude_sd))}  # fmt: skip
    keys = {INDEXING: "index_sd", LATITUDE: "latitude_sd"}
    sizes = {g: sizes[g] for g in names}
    sizes |= {n: (sd, assumed.get(n, f"{keys[n]} as given")) for n, sd in rig.items() if sd}
    none = np.zeros((1, 1))
    blank = Seen("source", none[0], none, 0.0, 0, 1.0, 1.0, 0.0)
    seen = dict.fromkeys(sizes, blank) | dict(first)
    total = fixes.cov[:, 0, 0]
    shares = {
        g: float(np.nanmax(fixes.sources[name][:, 0] / total, initial=0.0))
        for g in sizes if (name := words_of(g)) in fixes.sources
    }  # fmt: skip
    needed = {n: float(detectable(s, len(seen)).min(initial=np.inf)) for n, s in seen.items()}
    worst = {g: (names[g][far[0]], far[1]) for g in names
             if (far := farthest(seen[g])) is not None}  # fmt: skip
    return Judgement(seen, joined(named), needed, shares, tuple(sizes), sizes, worst)


def misfits(pairs: Pairs) -> bool:
    """Tell whether accelerometers of a set-up of `pairs` [SI] scatter as rarely as they should."""
    from scipy.special import chdtrc

    chance = chdtrc(np.maximum(pairs.dof[:, 1], 1), pairs.chi_square[:, 1])
    return bool(np.any((chance < MISFIT) & (pairs.dof[:, 1] > 0)))


def told(judged: Judgement) -> tuple[Finding, ...]:
    """Say in one sentence what is not estimated makes of the headings."""
    most = sorted(judged.share, key=lambda g: -judged.share[g])
    most = [g for g in most if judged.share[g] > MATTERS][:LISTED]
    if not most:
        return (finding("north.left_out_small"),)
    parts = ", ".join(
        f"{words_of(g)} {100 * judged.share[g]:.2g} % ({in_words(g, size)}; {basis})"
        for g in most for size, basis in [judged.sizes[g]]
    )  # fmt: skip
    return (finding("north.left_out", terms=parts),)
