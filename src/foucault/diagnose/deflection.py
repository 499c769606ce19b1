"""Do the gyros bend, and which model says how? Every model from one run with all 18 bendings.

A filter that estimates all bendings T beside everything else leaves, with what was known of them
before taken out, all that the session says of them: to second order its log-likelihood, greatest
over or averaged over everything else, is ::

    L(T) - L(0) = y' T - T' J T / 2,        J = P^-1 - P_0^-1,  y = P^-1 T_est - P_0^-1 T_0

and a model ``T = B theta`` has ``J_B = B' J B`` and ``y_B = B' y``. So no model needs a run of its
own, and all of them answer for the same readings with the same knowledge of everything else.

**With or without.** Without deflection y is Gaussian with covariance J, and twice the gain in
log-likelihood by the best theta, ``y_B' J_B^-1 y_B`` over the combinations that are seen, is
chi-square with as many degrees of freedom as there are of them. (It is the test of theta_est
against its covariance, too.) No prior of T is in it, and the false-alarm rate is what was asked
for; `velocity_sd` above the truth makes J smaller than it could be, and the test misses more, not
less. Several models are tested: each gets its share of the false-alarm rate.

**Which model.** Models with other combinations are not nested, and of some the session sees
only a part. Greatest likelihoods then need a correction for their number, and those of AIC and BIC
count parameters that are not seen. The likelihood averaged over theta, N(m, S), needs none::

    log p(z | B) / p(z | 0) = y_B' m - m' J_B m / 2 + r' (J_B + S^-1)^-1 r / 2
                              - log det(1 + J_B S) / 2,          r = y_B - J_B m

A combination that is not seen adds nothing to it. But with an S far wider than the deflection is,
it prefers models of which less is seen, and where nothing bends it finds those far better than any
other. So unless the user has said what is known, m = 0 and the size of S is the one that explains
the session best, up to the usual one [3]: no model is then less likely than none, and none is
believed because it is seen badly.

References
----------
.. [1] S. M. Kay, *Fundamentals of Statistical Signal Processing: Detection Theory*, 1998, sections
   6.5 (likelihood ratio and Wald tests) and 6.6 (their distribution).
.. [2] R. E. Kass, A. E. Raftery, "Bayes factors", *J. Am. Stat. Assoc.* 90 (1995) 773-795.
.. [3] E. I. George, D. P. Foster, "Calibration and empirical Bayes variable selection",
   *Biometrika* 87 (2000) 731-747.

What is said of the choice of a model of deflection: verdict, check, findings, table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout, Prior
from foucault.diagnose.checks import check
from foucault.diagnose.systematic import EACH, WANTED, WORTH
from foucault.errors import Finding, error, finding
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.models.deflection import MODELS, DeflectionModel, deflection_model
from foucault.result import Check

GENERAL18 = deflection_model("general18")

CONFIDENCE = 0.95  # Probability that no coefficient is larger than its bound [1].
SIZES = np.exp(np.arange(-14.0, 0.1, 0.25))  # Variances that are tried, over the usual one [1].
UNIT = np.radians(1.0 / 3600.0) / 9.80665  # 1 arcsec/g [rad/(m/s^2)].


def candidates(chirality: int = -1) -> tuple[DeflectionModel, ...]:
    """Return every model, in both senses where they differ, `chirality` [1] first."""
    out: list[DeflectionModel] = []
    for name in MODELS:
        one, other = (deflection_model(name, c) for c in (chirality, -chirality))
        both = np.concatenate([in_general(one), in_general(other)], axis=1)
        out += [one, other] if np.linalg.matrix_rank(both) > len(one) else [one]
    return tuple(out)


def in_general(model: DeflectionModel) -> FloatArray:
    """Return B: what parameters of a model make of those of "general18", shape (18, p) [1]."""
    return np.asarray(GENERAL18.basis.reshape(18, 27) @ model.basis.reshape(len(model), 27).T)


@dataclass(frozen=True)
class Told:
    """What a session says of the 18 bendings."""

    information: FloatArray  # (18, 18) J [(m/s^2)^2/rad^2]
    score: FloatArray  # (18,) y [(m/s^2)/rad]

    @classmethod
    def of(cls, states: CoefficientVector, mean: FloatArray) -> Told:
        """Take out what was known of the bendings beforehand.

        `states`: found with the model "general18": with covariance, and prior standard deviations
        that were not correlated [SI]; `mean` (18,): mean of the prior of the bendings [SI].
        """
        part = [states.layout.index(name) for name in GENERAL18.layout.names]
        assert states.cov is not None
        unit = states.prior_sd[part]
        after = np.linalg.inv(states.cov[np.ix_(part, part)] / np.outer(unit, unit))
        J = (after - np.eye(18)) / np.outer(unit, unit)
        y = (after @ (states.values[part] / unit) - mean / unit) / unit
        return cls((J + J.T) / 2, y)


@dataclass(frozen=True)
class Candidate:
    """How well one model explains a session."""

    model: DeflectionModel
    sided: bool  # whether its other sense is another model
    rank: int  # how many combinations of its parameters the session tells better than `WORTH` [1]
    square: float  # twice the gain in log-likelihood by the best values of these combinations [1]
    chance: float  # probability of so large a gain where nothing bends [1]
    # logarithm of how many times likelier the readings are with it than without any, averaged over
    # its parameters [1]
    log_odds: float
    # no parameter is larger, with the probability `CONFIDENCE`; infinite where not all combinations
    # are seen [rad/(m/s^2)]
    bound: float

    @property
    def whole(self) -> bool:
        """Whether the session sees all of it."""
        return self.rank == len(self.model)

    @property
    def label(self) -> str:
        """The model as people call it."""
        sense = f", chirality {self.model.chirality}" if self.sided else ""
        return f"{self.model.name}{sense}"


def candidate(
    told: Told, model: DeflectionModel, prior: CoefficientVector, *, sided: bool, known: bool
) -> Candidate:
    """Judge one model.

    `prior`: what was known of its parameters beforehand: values and prior_sd [SI]; `known`:
    whether the prior is what the user knows, and not only the most that is usual.
    """
    from scipy.special import chdtrc, ndtri

    B = in_general(model) * WORTH
    J, y, p = B.T @ told.information @ B, B.T @ told.score, len(model)
    values, vectors = np.linalg.eigh(J)
    seen = values >= 1.0
    rank = int(np.count_nonzero(seen))
    square = float(np.sum((vectors[:, seen].T @ y) ** 2 / values[seen]))
    bound = np.inf
    if rank == p:
        cov = np.linalg.inv(J)
        z = ndtri(1.0 - (1.0 - CONFIDENCE) / (2 * p))
        bound = float(np.max(np.abs(cov @ y) + z * np.sqrt(np.diag(cov)))) * WORTH
    chance = float(chdtrc(rank, square)) if rank else 1.0
    odds = _log_odds(J, y, (prior.values / WORTH, prior.prior_sd / WORTH), known)
    return Candidate(model, sided, rank, square, chance, odds, bound)


def _log_odds(
    J: FloatArray, y: FloatArray, prior: tuple[FloatArray, FloatArray], known: bool
) -> float:
    """Return the last equation of the module, at the size of S that is best or known."""
    mean, sd = prior
    values, vectors = np.linalg.eigh(J * np.outer(sd, sd))
    values = np.maximum(values, 0.0)
    square = (vectors.T @ (sd * (y - J @ mean))) ** 2
    size = np.ones((1, 1)) if known else SIZES[:, None]
    gain = np.sum(size * square / (1 + size * values) - np.log1p(size * values), axis=1) / 2
    return float(y @ mean - mean @ J @ mean / 2 + gain.max())


@dataclass(frozen=True)
class Choice:
    """All models side by side, and the one that is used."""

    candidates: tuple[Candidate, ...]
    # whether the user has said what is known of the parameters beforehand: then models that are not
    # seen whole can be used too
    known: bool
    used: Candidate | None  # the one that the result has; None where nothing is seen to bend

    @property
    def chance(self) -> float:
        """Probability that any model gains as much where nothing bends."""
        return min(1.0, len(self.candidates) * min(c.chance for c in self.candidates))

    @property
    def bends(self) -> bool:
        """Whether the gyros are seen to bend, at the false-alarm rate 1 %."""
        return self.chance < FALSE_ALARM

    @property
    def limit(self) -> float:
        """Log odds at which another model than the one used is to be believed."""
        return float(np.log((len(self.candidates) - 1) / EACH))

    def usable(self, c: Candidate) -> bool:
        """Return whether a model can be used: the session sees it whole, or a prior helps."""
        return c.whole or self.known

    @property
    def rival(self) -> Candidate:
        """The likeliest model but the one used."""
        return max((c for c in self.candidates if c is not self.used), key=lambda c: c.log_odds)

    def significant(self, c: Candidate) -> bool:
        """Return whether a model gains too much for chance, as one of several tests."""
        return len(self.candidates) * c.chance < FALSE_ALARM

    @property
    def lead(self) -> float:
        """Log odds of the one used over the likeliest other."""
        assert self.used is not None
        return self.used.log_odds - self.rival.log_odds

    @property
    def beaten(self) -> bool:
        """Whether another model is to be believed instead of the one used."""
        return self.lead < -self.limit

    @property
    def shares(self) -> dict[str, float]:
        """Probability of each model; none was likelier beforehand."""
        odds = np.array([c.log_odds for c in self.candidates])
        weights = np.exp(odds - odds.max())
        labels = (c.label for c in self.candidates)
        return dict(zip(labels, (weights / weights.sum()).tolist(), strict=True))


def judged(
    told: Told,
    priors: Prior,
    *,
    chirality: int = -1,
    known: bool = False,
) -> Choice:
    """Return all models side by side; none is used yet.

    `priors`: mean and standard deviation of parameters or groups of them, those of other models
    may be among them [SI]; `chirality`: the sense that is listed first [1]; `known`: whether the
    user has said what is known of the parameters beforehand.
    """
    models = candidates(chirality)
    names = [m.name for m in models]
    rows = []
    for model in models:
        prior = CoefficientVector.prior(model.layout, known_of(model.layout, priors))
        rows.append(candidate(told, model, prior, sided=names.count(model.name) > 1, known=known))
    return Choice(tuple(rows), known, None)


def known_of(layout: Layout, given: Prior) -> dict[str, tuple[float, float]]:
    """Return what of `given`, mean and sd [SI], is about the coefficients of a layout."""
    names = layout.names
    return {k: v for k, v in given.items() if any(n == k or n.startswith(f"{k}.") for n in names)}


def chosen(choice: Choice) -> Candidate | None:
    """Choose: of the models that can be used and gain too much for chance the likeliest.

    Raises ``systematic.choice_unseen`` where the session sees no model whole.
    """
    some = [c for c in choice.candidates if choice.usable(c)]
    if not some:
        ranks = ", ".join(f"{c.label} {c.rank} of {len(c.model)}" for c in choice.candidates)
        raise error("systematic.choice_unseen", ranks=ranks, wanted=WANTED["deflection"])
    return max(filter(choice.significant, some), key=lambda c: c.log_odds, default=None)


def deflection_check(choice: Choice) -> Check:
    """Return the check `deflection`: whether the gyros bend, how, and how sure that is."""
    used, rival = choice.used, choice.rival
    given: dict[str, Any] = {"bounds": _bounds(choice), "rival": rival.label, "rank": rival.rank}
    if used is None:
        given |= {"count": len(rival.model)}
        return check("deflection not seen", "deflection", choice.chance, FALSE_ALARM, None, given)
    given |= {
        "used": used.label, "count": len(used.model), "chance": likely(choice.chance),
        "seen": "" if rival.whole else f" (seen in part, {rival.rank} of {len(rival.model)})",
        "times": _times(abs(choice.lead)), "less": "less" if choice.lead >= 0 else "more",
    }  # fmt: skip
    key = "deflection" if choice.significant(used) else "deflection not significant"
    return check(key, "deflection", -choice.lead, None, choice.limit, given)


def _bounds(choice: Choice) -> str:
    """Say how large deflections can be, by the models that are seen whole."""
    some = [c for c in choice.candidates if c.whole]
    if not some:
        return ""
    best, worst = (f(some, key=lambda c: c.bound) for f in (min, max))
    said = [f"by {best.label} no coefficient is above {best.bound / UNIT:.2g} arcsec/g"]
    if worst.bound > 1.5 * best.bound:
        said.append(f"by {worst.label} none above {worst.bound / UNIT:.2g} arcsec/g")
    return f": {', '.join(said)} ({100 * CONFIDENCE:g} %)"


def likely(chance: float) -> str:
    """Write a probability, `chance` [1], that may be very small."""
    return f"{chance:.1g}" if chance > 1e-99 else "less than 1e-99"


def _times(log_odds: float) -> str:
    return f"{np.exp(log_odds):.2g} times" if log_odds < 6.0 else f"e^{log_odds:.0f} times"


def findings(choice: Choice, *, asked: bool) -> list[Finding]:
    """Name models that fit better, or as well, where one was `asked` to be chosen."""
    used = choice.used
    if used is not None and choice.beaten:
        rival = choice.rival
        cure = f'Set deflection = "{rival.model.name}"'
        if rival.sided:
            cure += f" and chirality = {rival.model.chirality}"
        if not choice.usable(rival):
            cure = "The session does not see it whole: add spins in six other poses, such as "
            cure += '"spins, icosahedral 6" after "spins, simple 6"'
        return [
            finding("systematic.choice_rival", used=used.label, rival=rival.label, cure=cure,
                    times=_times(-choice.lead))
        ]  # fmt: skip
    shares = {k: v for k, v in choice.shares.items() if v > FALSE_ALARM}
    if asked and used is not None and len(shares) > 1:
        each = ", ".join(f"{k} {100 * v:.0f} %" for k, v in shares.items())
        return [finding("systematic.choice_close", shares=each)]
    return []


def summary(choice: Choice) -> dict[str, Any]:
    """Return the verdict and all models for result.json, no deflection first."""
    none = {
        "model": "none", "chirality": None, "label": "none", "parameters": 0, "rank": 0,
        "log_likelihood": 0.0, "chance": None, "log_odds": 0.0, "bound": None, "usable": True,
        "used": choice.used is None,
    }  # fmt: skip
    bends = [
        {
            "model": c.model.name, "chirality": c.model.chirality if c.sided else None,
            "label": c.label, "parameters": len(c.model), "rank": c.rank,
            "log_likelihood": c.square / 2, "chance": c.chance, "log_odds": c.log_odds,
            "bound": c.bound if c.whole else None, "usable": choice.usable(c),
            "used": c is choice.used,
        }
        for c in choice.candidates
    ]  # fmt: skip
    return {
        "verdict": deflection_check(choice).sentence, "false_alarm": FALSE_ALARM,
        "chance": choice.chance, "limit": choice.limit, "models": [none, *bends],
    }  # fmt: skip
