"""What the fix of a north seeker does not estimate and counts with, as its calibration does.

Terms of the instrument are alike in all set-ups of a file; each set-up takes them with its own
attitude and stops. Where the latitude is known a set-up has four numbers and three unknowns: one is
left to test with. With L L' the covariance of the noise, n the direction of ``L^-1`` times the four
numbers that no angle explains, B the columns of all groups, calibration and latitude among them::

    z_i = n_i' L_i^-1 r_i   Z_i = n_i' L_i^-1 B_i   u = (I + Z'Z)^-1 Z'z   V = (I + Z'Z)^-1 Z'Z

Of many set-ups the products are enough, so that they are taken block by block.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray, by_number
from foucault.errors import Finding, finding
from foucault.estimate.north import LATITUDE, Fixes, Known, levelled
from foucault.estimate.north_reduction import INDEXING, Pairs, Roots, left_white
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
from foucault.logs.indexed import AT_ONCE
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.left_out import GRAVITY, Sizes, in_words, monomial, table, terms
from foucault.models.north_seeker import Compensation, Dwells
from foucault.procedures.north_seeking.counted import felt, on_case

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
class Terms:
    """What is not estimated of one instrument, the same for all its set-ups."""

    sizes: Sizes  # of the instrument and of gravity [SI]
    names: Mapping[str, tuple[str, ...]]  # group -> its terms
    felt: Mapping[str, list[int]]  # group -> the c of its terms that do something [1]
    # sensor, factors, size: (c,), (c, 3), (c,) of these terms, as of `kernels.north_seeking`
    sensor: IntArray
    factors: IntArray
    size: FloatArray
    columns: Mapping[str, slice]  # group -> which of all columns are its own

    @classmethod
    def of(cls, names: Sequence[str], site: Site, sizes: Sizes, case: bool) -> Terms:
        """Take all terms but those of `names`, which are estimated.

        `sizes`: as `counted.beside` has them [SI]; `case`: whether accelerometers stay with it.
        """
        whole = whole_sizes(sizes, site)
        every, seen = dict[str, tuple[str, ...]](), dict[str, list[int]]()
        columns, codes, size = dict[str, slice](), list[tuple[int, ...]](), list[float]()
        some = terms(names, replace(site, latitude=None), whole)
        for group, each in groupby(some, key=lambda term: term.group):
            own = [*each]
            every[group] = tuple(term.name for term in own)
            heavy = group == GRAVITY
            seen[group] = [k for k, term in enumerate(own) if heavy or felt(term, case)]
            columns[group] = slice(len(size), len(size) + len(seen[group]))
            for term in (own[k] for k in seen[group]):
                size.append(term.size)
                if heavy:
                    codes.append((-1, 0, 0, 0))
                    continue
                axis, inputs = monomial(term)
                sensor = group.startswith("accel") * (1 + (case and axis))
                codes.append((sensor, *inputs))
        code = np.array(codes, np.int64).reshape(-1, 4)
        factors = np.ascontiguousarray(code[:, 1:])
        return cls(whole, every, seen, code[:, 0].copy(), factors, np.array(size), columns)


@dataclass(frozen=True)
class Left:
    """What set-ups are off by that nobody estimates."""

    pairs: Pairs  # of the readings alone [SI]
    known: Known
    compensation: Compensation
    angles: FloatArray  # (m, 4) attitudes that were found, and latitudes [rad]
    terms: Terms
    whole: FloatArray  # (m, 4, c) what one size of each of these does [SI]

    @classmethod
    def of(
        cls, dwells: Dwells, pairs: Pairs, angles: FloatArray, known: Known,
        compensation: Compensation, own: Terms, span: tuple[float, float],
    ) -> Left:  # fmt: skip
        """Take all terms at solutions `angles` (m, 4) [rad]; `span`: of the whole file [s]."""
        from foucault.kernels.north_seeking import left_batch

        angles = np.where(np.isfinite(angles), angles, 0.0)
        m, c = len(pairs), len(own.size)
        B = np.empty((m, 4, c))
        left_batch(
            angles, np.full(m, known.gravity), EARTH_RATE, compensation.model.accel_matrix[:2],
            dwells.first, dwells.cosine, dwells.sine, _ramp(dwells, span), pairs.gyro_weights,
            pairs.accel_weights, on_case(dwells), own.sensor, own.factors, own.size, B,
        )  # fmt: skip
        return cls(pairs, known, compensation, angles, own, B)

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Groups that do something to these set-ups -> their terms."""
        return {g: self.terms.names[g] for g, at in self.terms.columns.items()
                if self.whole[:1, :, at].any() or self.whole[:, :, at].any()}  # fmt: skip

    def counted(self, times: Mapping[str, float]) -> tuple[Pairs, Known]:
        """Return the set-ups with the covariance of all groups, and the place as it counts.

        `times`: group -> how many sizes it has, where that is not one [1].
        """
        sizes = np.ones(self.whole.shape[2])
        for g in times.keys() & self.terms.names:
            sizes[self.terms.columns[g]] = times[g]
        whole = self.whole if (sizes == 1.0).all() else sizes * self.whole
        columns = self.terms.columns.values()
        first = np.array([0, *(at.stop for at in columns)], np.int64)
        roots = [Roots(whole, tuple(words_of(g) for g in self.terms.columns), first)]
        more = times.get(CALIBRATION, 1.0)
        if more > 1.0:
            each = np.sqrt(more**2 - 1) * self._calibration()
            beyond = f"{CALIBRATION} beyond what it says"
            roots.append(Roots(each, (beyond,), np.array([0, each.shape[2]], np.int64)))
        wider = self.known.latitude_sd * times.get(LATITUDE, 1.0)
        return replace(self.pairs, roots=tuple(roots)), replace(self.known, latitude_sd=wider)

    def _calibration(self) -> FloatArray:
        """Return what one sd of the calibration does to the four numbers, (m, 4, c) [SI]."""
        cov = self.compensation.coefficients.cov
        if cov is None or not len(cov):
            return np.zeros((len(self.pairs), 4, 0))
        size, axes = np.linalg.eigh(cov)
        root = axes * np.sqrt(np.maximum(size, 0.0))
        return self.compensation.spread(self.angles, self.known.gravity, root)

    def products(self, good: BoolArray) -> Products:
        """Return the one number of each set-up that no angle explains, in products.

        `good` (m,): which are solved.
        """
        from foucault.kernels.north_seeking import across_batch

        known, model = self.known, self.compensation.model
        calibration = self._calibration()
        each_own = isinstance(known.latitude_sd, np.ndarray)  # of each set-up by itself: noise
        wide = known.latitude is not None and not each_own and bool(known.latitude_sd)
        groups = {g: len(names) for g, names in self.terms.names.items()}
        groups |= {CALIBRATION: calibration.shape[2]} | ({LATITUDE: 1} if wide else {})
        size, at = 1, [0]  # in the order of all terms; of those that do nothing it is nothing
        for group, count in groups.items():
            at += [size + k for k in self.terms.felt.get(group, range(count))]
            size += count
        if known.latitude is None or not good.any():
            return Products(np.zeros((size, size)), 0, groups)
        pairs, T = levelled(self.pairs, known, self.compensation)
        m, c = len(good), self.whole.shape[2] + calibration.shape[2]
        each = np.empty((m, 1 + c + wide))
        across_batch(
            pairs.values, pairs.cov,
            np.column_stack([self.angles[:, :3], np.full(m, known.latitude)]),
            np.vstack([model.gyro_matrix[:2], model.accel_matrix[:2]]),
            np.concatenate([model.gyro_bias[:2], model.accel_bias[:2]]),
            np.full(m, known.gravity), EARTH_RATE, np.full(m, known.latitude_sd * each_own),
            np.eye(4)[None] if T is None else T, self.whole, calibration,
            float(known.latitude_sd) if wide else 0.0, each,
        )  # fmt: skip
        each[~good] = 0.0
        sums = np.zeros((size, size))
        sums[np.ix_(at, at)] = each.T @ each
        return Products(sums, int(good.sum()), groups)


def _ramp(dwells: Dwells, span: tuple[float, float]) -> FloatArray:
    """Return what a drift of one size is at every reading [SI] of a file that spans so much [s]."""
    return np.asarray((dwells.start + dwells.time / 2 - span[0]) / (span[1] - span[0]) - 0.5)


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


@dataclass(frozen=True)
class Scatter:
    """Products of residuals of accelerometers with what one size of their terms leaves in them.

    What goes twice per turn is in no rate and no tilt, but in what four stops leave of one another.
    """

    products: FloatArray  # (1 + c, 1 + c) of the residuals, and of c terms [1]
    groups: tuple[str, ...]  # that each term is of

    @classmethod
    def of(
        cls, pairs: Pairs, dwells: Dwells, f_b: FloatArray, span: tuple[float, float], own: Terms
    ) -> Scatter:
        """Take set-ups with their readings, at true specific forces `f_b` (m, 3) in the case [SI].

        `span`: of the whole file [s]; `own`: terms of accelerometers alone.
        """
        from foucault.kernels.north_seeking import felt_batch

        n, q = pairs.accel_white.shape
        some = np.flatnonzero(own.sensor > 0)
        more = np.empty((n, q, len(some)))
        felt_batch(
            f_b, dwells.setup, dwells.cosine, dwells.sine, _ramp(dwells, span), on_case(dwells),
            own.sensor[some], own.factors[some], own.size[some], more,
        )  # fmt: skip
        each = np.concatenate([pairs.accel_white[:, :, None], left_white(pairs, more)], axis=2)
        each = each.reshape(n * q, -1)
        groups = (g for g, at in own.columns.items() for _ in range(at.start, at.stop))
        return cls(np.asarray(each.T @ each), tuple(g for g in groups if g != GRAVITY))

    def __add__(self, more: Scatter) -> Scatter:
        return replace(self, products=self.products + more.products)

    def accounted(self, pairs: Pairs, times: Mapping[str, float]) -> Pairs:
        """Return set-ups, all of these, without what the terms explain of their residuals.

        ``r' (I + B B')^-1 r`` has the degrees of freedom that r'r has without B.

        `pairs`: [SI]; `times`: group -> how many sizes it has, where that is not one [1].
        """
        scale = np.array([1.0, *(times.get(g, 1.0) for g in self.groups)])
        products = scale[:, None] * self.products * scale
        total, u, G = float(products[0, 0]), products[1:, 0], products[1:, 1:]
        if not total:
            return pairs
        left = total - float(u @ np.linalg.solve(np.eye(len(u)) + G, u))
        chi_square = pairs.chi_square.copy()
        chi_square[:, 1] *= left / total
        return replace(pairs, chi_square=chi_square)


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
    of = {g: name for g in sizes if (name := words_of(g)) in fixes.sources}
    shares = dict.fromkeys(of, 0.0)
    for start in range(0, len(fixes), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        total = fixes.cov[some, 0, 0]
        for g, name in of.items():
            part = np.nanmax(fixes.sources[name][some, 0] / total, initial=0.0)
            shares[g] = max(shares[g], float(part))
    needed = {n: float(detectable(s, len(seen)).min(initial=np.inf)) for n, s in seen.items()}
    worst = {g: (names[g][far[0]], far[1]) for g in names
             if (far := farthest(seen[g])) is not None}  # fmt: skip
    return Judgement(seen, joined(named), needed, shares, tuple(sizes), sizes, worst)


def misfits(pairs: Pairs) -> bool:
    """Tell whether accelerometers of a set-up of `pairs` [SI] scatter as rarely as they should."""
    from scipy.special import chdtri

    most = by_number(pairs.dof[:, 1], lambda n: float(chdtri(n, MISFIT)) if n else np.inf)
    return bool((pairs.chi_square[:, 1] > most).any())


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
