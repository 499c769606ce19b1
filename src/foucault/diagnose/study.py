"""Judge a Monte Carlo study: are the errors as large as the uncertainties say?

An error e with covariance P has the normalised square ``e' inv(P) e``, which is chi-square with
as many degrees of freedom as e has entries where P is right. Of estimation errors it is called
NEES (the truth must be known), of innovations NIS (it needs no truth).

For every coefficient: mean error against zero, root mean square error against the predicted
standard deviation, coverage of the 68 % and 95 % intervals. For all together: NEES against
chi-square. Limits are two-sided and share one family-wise false-alarm rate.

References
----------
.. [1] Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
   Navigation*, Wiley, 2001, section 5.4 (NEES and NIS tests).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray
from foucault.diagnose.checks import check
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.result import Check


def nees(errors: FloatArray, cov: FloatArray) -> FloatArray:
    """Return the normalised estimation error squared, ``e' inv(P) e``, of each trial.

    `errors` (trials, n): estimate minus truth [SI]; `cov` (trials, n, n) or (n, n): predicted
    covariance [SI]. Returns (trials,): NEES; chi-square with n degrees of freedom where the
    covariance is right [1].
    """
    scale = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
    unit = errors / scale
    correlation = cov / (scale[..., :, None] * scale[..., None, :])
    solved = np.linalg.solve(correlation, unit[..., None])[..., 0]
    return np.asarray(np.sum(unit * solved, axis=-1))


def consistency_check(
    name: str, squares: FloatArray, dof: int, false_alarm: float = FALSE_ALARM
) -> Check:
    """Test the mean of `squares` (n,) of `dof` each, failing so often: `false_alarm` [1]."""
    n = len(squares)
    low, high = (v / (n * dof) for v in chi_square_limits(n * dof, false_alarm))
    value = float(np.mean(squares) / dof)
    return check("consistency", name, value, low, high, {"name": name})


EACH = FALSE_ALARM / 5
"""False-alarm rate of each of the five checks of a study, so that all together keep 1 % [1]."""

INTERVALS = {68: 0.994458, 95: 1.959964}
"""Percent of a normal distribution within this many standard deviations [1]."""


@dataclass(frozen=True)
class Study:
    """The trials of a study that produced an estimate."""

    names: tuple[str, ...]
    error: FloatArray  # (trials, n) estimate minus truth [SI]
    sd: FloatArray  # (trials, n) predicted standard deviation [SI]
    # (trials, n) Cramer-Rao bound, NaN where the procedure does not give one [SI]
    bound: FloatArray
    nees: FloatArray  # (trials,) normalised estimation error squared [1]
    status: Mapping[str, int]  # how many trials ended in each status, failures included [1]
    # (trials, n) degrees of freedom that the variance was found from, infinite where it is known
    dof: FloatArray | float = np.inf

    @classmethod
    def of(cls, names: Sequence[str], rows: Mapping[str, npt.NDArray[Any]]) -> Study:
        """Take the columns ``error.*``, ``sd.*``, ``bound.*``, ``dof.*``, ``nees`` and ``status``.

        `rows` (trials,): columns of the study [SI].
        """
        good = np.isfinite(rows["nees"])
        kinds, counts = np.unique(rows["status"].astype(str), return_counts=True)

        def block(prefix: str) -> FloatArray:
            out = np.empty((int(good.sum()), len(names)), order="F")  # each column is looked at
            for k, name in enumerate(names):
                out[:, k] = rows[f"{prefix}.{name}"][good]
            return out

        status = dict(zip(kinds.tolist(), counts.tolist(), strict=True))
        nees = np.asarray(rows["nees"][good], float)
        dof = block("dof") if f"dof.{names[0]}" in rows else np.inf
        return cls(tuple(names), block("error"), block("sd"), block("bound"), nees, status, dof)

    def rows(self) -> list[dict[str, Any]]:
        """Return one dictionary per coefficient: mean, RMS, predicted sd, ratios, coverage.

        None where no trial produced an estimate.
        """
        n = len(self.error)
        if n == 0:
            return []
        tests = len(self.names)
        low, high = (np.sqrt(v / n) for v in chi_square_limits(n, EACH, tests))
        bias_limit = np.sqrt(chi_square_limits(1, 2 * EACH, tests)[1])
        out, within = [], {p: self._inside(p) for p in INTERVALS}
        for k, name in enumerate(self.names):
            z = self.error[:, k] / self.sd[:, k]
            mean_z = float(z.mean() * np.sqrt(n))
            ratio = float(np.sqrt(np.mean(z**2)))
            bound = float(np.sqrt(np.mean(self.bound[:, k] ** 2)))
            rms = float(np.sqrt(np.mean(self.error[:, k] ** 2)))
            out.append(
                {
                    "name": name,
                    "mean": float(self.error[:, k].mean()),
                    "rms": rms,
                    "sd": float(np.sqrt(np.mean(self.sd[:, k] ** 2))),
                    "bound": bound,
                    "rms_over_bound": rms / bound if bound > 0 else float("nan"),
                    "mean_z": mean_z,
                    "mean_z_limit": float(bias_limit),
                    "unbiased": bool(abs(mean_z) <= bias_limit),
                    "ratio": ratio,
                    "ratio_low": float(low),
                    "ratio_high": float(high),
                    "consistent": bool(low <= ratio <= high),
                    **{
                        f"coverage_{p}": float(np.mean(inside[:, k]))
                        for p, inside in within.items()
                    },
                }
            )
        return out

    def checks(self) -> tuple[Check, ...]:
        """Return the tests of the study as a whole, one sentence each."""
        if len(self.nees) == 0:
            return (check("no trial", "trials", 0.0, 1.0),)
        per = self.rows()
        total = sum(self.status.values())
        bad = total - self.status.get("converged", 0)
        parts = ", ".join(f"{count} {kind}" for kind, count in sorted(self.status.items()))
        given = {"total": total, "parts": parts}
        return (
            consistency_check("NEES", self.nees, len(self.names), EACH),
            _counted("bias", per, "unbiased", "mean error", "zero"),
            _counted("spread", per, "consistent", "scatter", "its predicted uncertainty"),
            *(self._coverage(p, share) for p, share in ((68, 0.68), (95, 0.95))),
            check("failures", "failures", bad / total, None, 0.01, given),
        )

    def _inside(self, percent: int) -> BoolArray:
        """Tell which truths are inside their intervals, shape (trials, n).

        Of a variance that was found from v degrees of freedom they are Student's, and what is
        stated is ``v / (v - 2)`` times as large as the most likely one.
        """
        from scipy.special import ndtr, stdtrit

        limit, dof = INTERVALS[percent], np.broadcast_to(self.dof, self.error.shape)
        inside = np.abs(self.error) <= limit * self.sd
        found = np.isfinite(dof)
        v = dof[found]
        wide = stdtrit(v, ndtr(limit)) * np.sqrt(1 - 2 / v)
        inside[found] = np.abs(self.error[found]) <= wide * self.sd[found]
        return inside

    def _coverage(self, percent: int, share: float) -> Check:
        """Count intervals of independent trials: each trial counts once, by its own fraction."""
        n, k = self.error.shape
        per_trial = self._inside(percent).mean(axis=1)
        value = float(per_trial.mean())
        from scipy.special import stdtrit

        # The scatter over trials carries the correlation between coefficients; of few trials it is
        # itself uncertain (Student's t). By chance it can come out below that of independent
        # coefficients, where it cannot be: symmetric intervals of normal errors never exclude one
        # another (the Gaussian correlation inequality).
        scatter = max(float(per_trial.std(ddof=1)), np.sqrt(share * (1 - share) / k))
        width = float(stdtrit(n - 1, 1 - EACH / 2) * scatter / np.sqrt(n))
        return check("coverage", f"coverage of {percent} %", 100 * value, 100 * (share - width),
                     100 * (share + width), {"percent": percent})  # fmt: skip


def _counted(name: str, per: list[dict[str, Any]], key: str, what: str, against: str) -> Check:
    failed = [row["name"] for row in per if not row[key]]
    given = {"what": what, "failed": ", ".join(failed), "against": against}
    return check("every coefficient", name, float(len(failed)), None, 0.0, given)
