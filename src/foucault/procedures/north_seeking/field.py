"""What the fix of a north seeker does not estimate and counts with, as its calibration does.

Terms of the instrument are alike in all set-ups of a file; each set-up takes them with its own
attitude and stops. Where the latitude is known a set-up has four numbers and three unknowns: one is
left to test with. With L L' the covariance of the noise, n the direction of ``L^-1`` times the four
numbers that no angle explains, B the columns of all groups, calibration and latitude among them::

    z_i = n_i' L_i^-1 r_i   Z_i = n_i' L_i^-1 B_i   u = (I + Z'Z)^-1 Z'z   V = (I + Z'Z)^-1 Z'Z
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, finding
from foucault.estimate.north import LATITUDE, Fixes, Known, levelled
from foucault.estimate.north_reduction import INDEXING, Nuisance, Pairs, reduce
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
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import GRAVITY, Motion, Sizes, changes, in_words, table, terms
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import Compensation, Dwells, earth_rate_b, up_b
from foucault.procedures.north_seeking.counted import accounted, added, moved

CALIBRATION, SCATTER = "errors of the calibration", "scatter of the set-ups"

HOUR = 3600.0
"""A drift is of one size over this time at least, for one set-up takes minutes [s]."""

STEP = 1e-5
"""Of the slopes of readings against angles [rad]."""

MISFIT = 1e-5
"""A set-up whose accelerometers scatter as rarely as that may be due to terms of theirs [1]."""

LISTED = 3
"""Groups that a sentence names [1]."""


def words_of(group: str) -> str:
    """Return what a budget calls a group."""
    known = table().groups
    return known[group].what if group in known else group


@dataclass(frozen=True)
class Left:
    """What set-ups are off by that nobody estimates."""

    pairs: Pairs  # of the readings alone [SI]
    known: Known
    compensation: Compensation
    motion: Motion  # of the readings at the attitudes that were found
    truth: tuple[FloatArray, FloatArray]  # (m, 3) rate and specific force in the case [SI]
    sizes: Sizes  # of the instrument and of gravity [SI]
    names: Mapping[str, tuple[str, ...]]  # group -> its terms
    columns: Mapping[str, FloatArray]  # group -> (m, 4, c) what one size of each does [SI]
    times: Mapping[str, float] = field(default_factory=dict)  # group -> sizes that it has [1]

    @classmethod
    def of(
        cls, dwells: Dwells, pairs: Pairs, fixes: Fixes, known: Known, compensation: Compensation,
        site: Site, sizes: Sizes,
    ) -> Left:  # fmt: skip
        """Take all terms at the attitudes of `fixes`; `sizes` as `counted.beside` leaves them."""
        angles = np.where(np.isfinite(fixes.angles), fixes.angles, 0.0)
        w_b, f_b = _truth(angles, known)
        motion = moved(dwells, f_b, w_b)
        motion = motion._replace(end=max(motion.end, motion.begin + HOUR))
        whole = {**sizes, GRAVITY: (site.gravity_sd, "standard uncertainty of local gravity")}
        some = terms(compensation.coefficients.names, replace(site, latitude=None), whole)
        columns, names = dict[str, FloatArray](), dict[str, tuple[str, ...]]()
        for group, each in groupby(some, key=lambda term: term.group):
            own = [*each]
            if group == GRAVITY:
                more = f_b * (1 + own[0].size / np.reshape(known.gravity, (-1, 1)))
                made = [compensation.predict(w_b, more) - compensation.predict(w_b, f_b)]
            else:
                made = [added(pairs, dwells, by) for by in changes(own, ImuModel(), motion)]
            if np.any(made):
                columns[group] = np.stack(made, axis=2)
                names[group] = tuple(term.name for term in own)
        return cls(pairs, known, compensation, motion, (w_b, f_b), whole, names, columns)

    def counted(self) -> tuple[Pairs, Known]:
        """Return the set-ups with the covariance of all groups, and the place as it counts."""
        parts = {words_of(g): self.times.get(g, 1.0) ** 2 * B @ np.swapaxes(B, 1, 2)
                 for g, B in self.columns.items()}  # fmt: skip
        more = self.times.get(CALIBRATION, 1.0)
        if more > 1.0:
            B = self._calibration()
            parts[f"{CALIBRATION} beyond what it says"] = (more**2 - 1) * B @ np.swapaxes(B, 1, 2)
        wider = self.known.latitude_sd * self.times.get(LATITUDE, 1.0)
        pairs = replace(self.pairs, sources=self.pairs.sources | parts)
        return pairs, replace(self.known, latitude_sd=wider)

    def _calibration(self) -> FloatArray:
        """Return what one sd of the calibration does to the four numbers, (m, 4, c) [SI]."""
        cov = self.compensation.coefficients.cov
        if cov is None or not len(cov):
            return np.zeros((len(self.pairs), 4, 0))
        size, axes = np.linalg.eigh(cov)
        root = axes * np.sqrt(np.maximum(size, 0.0))
        return np.asarray(self.compensation.slopes(*self.truth) @ root)

    def judged(self, fixes: Fixes) -> tuple[Left, dict[str, Seen], list[dict[str, float]]]:
        """Test every group on what the angles of `fixes` leave; enlarge what is contradicted.

        Set-ups that scatter as nothing of it explains are tested by their scatter: their checks say
        how large that is. Returns also every group as it was tested first, and who was named.
        """
        z, columns = self._left(fixes)
        times, named, first = dict[str, float](), list[dict[str, float]](), dict[str, Seen]()
        scattering = 1.0
        for _ in range(ROUNDS):
            seen = _tested(
                z / scattering, {g: times.get(g, 1.0) / scattering * Z for g, Z in columns.items()}
            )
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
        return replace(self, times=times), first, named

    def _left(self, fixes: Fixes) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Return the one number of each set-up that no angle explains, and of each column [1]."""
        known, compensation = self.known, self.compensation
        columns = {**self.columns, CALIBRATION: self._calibration()}
        good = (fixes.status == 0) & np.isfinite(fixes.angles).all(axis=1)
        if known.latitude is None or not good.any():
            return np.zeros(0), {g: np.zeros((0, B.shape[2])) for g, B in columns.items()}
        pairs, T = levelled(self.pairs, known, compensation)
        angles = np.column_stack([fixes.angles[:, :3], np.full(len(good), known.latitude)])

        def said(angles: FloatArray) -> FloatArray:
            return compensation.predict(*_truth(angles, known))

        slopes = [(said(angles + d) - said(angles - d)) / (2 * STEP) for d in STEP * np.eye(4)]
        J, latitude = np.stack(slopes[:3], axis=2), slopes[3][:, :, None]
        cov = pairs.cov
        if isinstance(known.latitude_sd, np.ndarray):  # of each set-up by itself: noise
            own = latitude * known.latitude_sd[:, None, None]
            cov = cov + own @ np.swapaxes(own, 1, 2)
        elif known.latitude_sd:
            columns[LATITUDE] = latitude * known.latitude_sd
        L = np.linalg.cholesky(cov[good])
        n = np.linalg.qr(np.linalg.solve(L, J[good]), mode="complete")[0][:, :, 3]
        back = np.linalg.solve(np.swapaxes(L, 1, 2), n[:, :, None])[:, :, 0]  # n' L^-1
        z = np.einsum("ni,ni->n", back, (pairs.values - said(angles))[good])
        return z, {g: np.einsum("ni,nic->nc", back, (T @ B)[good]) for g, B in columns.items()}


def _truth(angles: FloatArray, known: Known) -> tuple[FloatArray, FloatArray]:
    """Return rate and specific force in the case (m, 3) [SI] at `angles` (m, 4) [rad]."""
    up = up_b(angles[:, 1], angles[:, 2])
    return earth_rate_b(*angles.T), np.reshape(known.gravity, (-1, 1)) * up


def _tested(z: FloatArray, columns: Mapping[str, FloatArray]) -> dict[str, Seen]:
    """Test groups by `z` (m,) and their `columns` (m, c) each, and whether set-ups scatter [1]."""
    from scipy.special import chdtrc

    Z = np.concatenate([*columns.values()], axis=1)
    A = Z.T @ Z
    inner = np.eye(len(A)) + A
    u, V = np.linalg.solve(inner, Z.T @ z), np.linalg.solve(inner, A)
    out, at = dict[str, Seen](), 0
    for group, B in columns.items():
        own = slice(at, at := at + B.shape[1])
        if B.shape[1]:
            kind = "prior" if group in (CALIBRATION, LATITUDE) else "source"
            out[group] = seen_of(kind, u[own], (V[own, own] + V[own, own].T) / 2)  # type: ignore[arg-type]
    if len(z) > 1:
        total = float(z @ z - (Z.T @ z) @ u)
        mean, none = total / len(z), np.zeros((1, 1))
        gain = len(z) * (mean - 1.0 - np.log(max(mean, 1e-300))) if mean > 1.0 else 0.0
        out[SCATTER] = Seen("scatter", none[0], none, total, len(z), float(chdtrc(len(z), total)),
                            max(mean, 1.0) ** 0.5, gain)  # fmt: skip
    return out


def judgement(
    left: Left, fixes: Fixes, first: Mapping[str, Seen], named: list[dict[str, float]],
    index_sd: float, assumed: Mapping[str, str],
) -> Judgement:  # fmt: skip
    """Say what was made of every group, and what it is of the heading of `fixes` [rad].

    `named`: sets of groups and how many times they were enlarged [1]; `index_sd`: of every index
    angle [rad]; `assumed`: source -> basis, where nobody said its size.
    """
    rig = {INDEXING: index_sd, LATITUDE: 0.0 if left.known.latitude is None else
           float(np.max(left.known.latitude_sd))}  # fmt: skip
    keys = {INDEXING: "index_sd", LATITUDE: "latitude_sd"}
    sizes = {g: left.sizes[g] for g in left.columns}
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
    worst = {g: (left.names[g][far[0]], far[1]) for g in left.columns
             if (far := farthest(seen[g])) is not None}  # fmt: skip
    return Judgement(seen, joined(named), needed, shares, tuple(sizes), sizes, worst)


def accelerometers(
    pairs: Pairs, dwells: Dwells, noise: ImuNoise, nuisance: Nuisance, site: Site, left: Left
) -> Pairs:
    """Return set-ups without what terms of the accelerometers explain of their scatter."""
    from scipy.special import chdtrc

    chance = chdtrc(np.maximum(pairs.dof[:, 1], 1), pairs.chi_square[:, 1])
    if not np.any((chance < MISFIT) & (pairs.dof[:, 1] > 0)):
        return pairs
    again = partial(reduce, noise=noise, nuisance=nuisance)
    return accounted(pairs, site, again, dwells, left.motion, left.times, left.sizes)


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
