"""Rests by hand: what those so far have shown, and which one would show most next.

What was seen is the model of `hand_rotated`, solved as its calibration solves it; before there are
rests enough it is linearised only, with a wide prior. A rest to come is a reading of the same
model. All that are possible are stated at once, as one session that goes out from where the
instrument lies to each of them and back: of every pair of rows the way out is taken.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.capture.step import UP, Begun, Reached, Step, cov_of, turn_time
from foucault.coefficients import CoefficientVector
from foucault.detect.coverage import named_directions
from foucault.detect.stretches import Rests
from foucault.errors import FoucaultError
from foucault.estimate.hand_rotated import first_guess, reckoned
from foucault.infer import mixed
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rests_and_turns import Attitudes, Session
from foucault.models.rotation import aligning, exp
from foucault.models.rotation import log as rotation_vector
from foucault.plans.directions import RestPlan
from foucault.procedures import hand_rotated, left_out
from foucault.simulate.hand_rotated import simulate
from foucault.tables import Log

ENOUGH = hand_rotated.NEEDED + 1
"""Rests from which on the session is solved [1]."""

FACINGS = np.radians([0.0, 90.0, 180.0, -90.0])
"""Ways round in which each orientation is tried [rad]."""

NEAR = np.radians(20.0)
"""Nearer orientations are no other ones [rad]."""

DRAWN_AT = 25.0
"""Rate at which turns to come are drawn: only their path counts [Hz]."""

TOGETHER = 8
"""Steps that are stated at once: more make matrices that are mostly empty [1]."""


class ByHand(Begun):
    """What a session by hand has shown, and what it could show next."""

    def first_step(self) -> Step:
        return Step("rest", UP, 2 * self.hold)

    def reached(self, log: Log, first: IntArray, last: IntArray) -> Reached:
        site, declared = self.given.site, self.given.noise is not None
        data, rests = Session.reduce(log, first, last, site), Rests(first, last)
        start = first_guess(data) if len(first) >= ENOUGH else None
        if start is None:
            start = self._reckoned(data)
        model = hand_rotated.model_of(data, rests, self.given, start)
        if len(first) >= ENOUGH:
            try:
                own = CoefficientVector.prior(model.layout, self.given.prior)
                again = hand_rotated.again_of(model)
                fit, judged = left_out.fit(model, own, self.given.sizes, site, again)
                if np.isfinite(fit.estimate.coefficients.sd).all():
                    return Reached.of_fit(fit, judged, model, own, start.C_nb)
            except (FoucaultError, np.linalg.LinAlgError):
                pass  # rests that are too much alike
        # Scatter that nobody has measured yet counts for nothing.
        sds = {} if declared else mixed.by_chance(model)
        return Reached.foreseen(model, sds, self.prior, start.C_nb)

    def _reckoned(self, data: Session) -> Attitudes:
        model = ImuModel.from_coefficients(CoefficientVector.prior(self.wanted.layout,
                                                                   self.given.prior))  # fmt: skip
        if data.gyro_mean is not None:
            weight = data.rest_time / data.rest_time.sum()
            model = replace(model, gyro_bias=weight @ data.gyro_mean)
        f_b, _ = model.compensate(data.accel_mean, None)
        assert f_b is not None
        up_b = f_b / np.linalg.norm(f_b, axis=1)[:, None]
        if data.gyro_mean is None:
            return Attitudes(model, np.stack([aligning(u, UP) for u in up_b]))
        return reckoned(data, model, up_b)

    def candidates(self, reached: Reached) -> list[Step]:
        C_nb = reached.C_nb
        away = C_nb[0] @ np.array([0.0, 1.0, 0.0])  # the front of the first rest
        heading = float(np.arctan2(-away[0], away[1]))
        facings = FACINGS[: 1 if not self.gyro else 2 if self.given.sizes else 4]
        out = []
        for up in named_directions():
            for h in facings:
                C = exp((heading + h) * UP) @ _upright(up)
                turn = rotation_vector(C_nb[-1].T @ C)
                if np.linalg.norm(turn) > NEAR:
                    out.append(Step("rest", up, self.hold, C, turn))
        if self.gyro:  # once round where it lies, either way: the way there may have wound a cable
            up = C_nb[-1].T @ UP
            out += [Step("turn", up, self.hold, C_nb[-1], sign * 2 * np.pi * up)
                    for sign in (1.0, -1.0)]  # fmt: skip
        return out

    def after(self, reached: Reached, steps: list[Step]) -> FloatArray:
        """Return the sd of every coefficient after each of `steps`, shape (k, p) [SI].

        What many readings share is a state beside the coefficients: what is left out, the Earth's
        rotation where no latitude is given. Drifts and slow noise are not: they are no place.
        """
        p, tied, unit, before = self._joint(reached)
        out = np.empty((len(steps), p))
        for seconds in sorted({s.seconds for s in steps}):
            mine = [k for k, s in enumerate(steps) if s.seconds == seconds]
            J = self._rows(reached, [steps[k] for k in mine], tied)
            at = np.concatenate([np.arange(p + 3), [p, p + 1, p + 2], np.arange(p + 3, len(unit))])
            J = (J * unit[at]).reshape(len(mine), -1, len(at))
            whole = np.swapaxes(J, 1, 2) @ J
            old = np.concatenate([np.arange(p + 3), np.arange(p + 6, len(at))])
            whole[:, old[:, None], old] += before
            inverse = np.linalg.inv(whole)
            out[mine] = np.sqrt(np.einsum("kii->ki", inverse)[:, :p])
        now = np.sqrt(np.diag(np.linalg.inv(before))[:p])
        return np.asarray(reached.sd * out / now)

    def _joint(
        self, reached: Reached
    ) -> tuple[int, list[tuple[str, float, int]], FloatArray, FloatArray]:
        """Return what is known of coefficients, the attitude now, and what readings share.

        Returns the coefficients p, name, size and number of each shared cause, the units of all
        (p + 3 + t,), and their information in these units (p + 3 + t, p + 3 + t).
        """
        at, p = reached.at, len(reached.model.layout)
        n, d, m = at.jacobian.shape
        shared = [s for s in at.sources if _is_place(s)]
        tied = [(s.name, mixed.size_of(s, reached.sds), s.shared.shape[2])
                for s in shared if s.shared is not None]  # fmt: skip
        own = [s for s in at.sources if not _is_place(s)]
        B = [size * s.shared for s, (_, size, _) in zip(shared, tied, strict=True)
             if s.shared is not None]  # fmt: skip
        both = np.concatenate([at.jacobian, *B], axis=2)
        white = mixed.Covariance(own, reached.sds, (n, d), np.ones(n)).whiten(both)
        t = white.shape[1] - m
        rows = [white, np.eye(m + t)[m:]]
        if at.known is not None:
            rows.append(np.pad(at.known[1], ((0, 0), (0, t))))
        has = np.flatnonzero(np.isfinite(reached.prior.prior_sd) & (reached.prior.prior_sd > 0))
        rows.append(np.eye(m + t)[has] / reached.prior.prior_sd[has, None])
        cov = cov_of(np.concatenate(rows))
        keep = np.concatenate([np.arange(p), m - 3 + np.arange(3), m + np.arange(t)])
        cov = cov[np.ix_(keep, keep)]
        unit = np.sqrt(np.diag(cov))
        return p, tied, unit, np.linalg.inv(cov / np.outer(unit, unit))

    def _rows(
        self, reached: Reached, steps: list[Step], tied: list[tuple[str, float, int]]
    ) -> FloatArray:
        """Return white rows of the readings of each step, shape (k, r, 3, p + 6 + t)."""
        own, p = reached.model, len(reached.model.layout)
        plan, site = out_and_back(reached.C_nb[-1], steps), self.given.site
        drawn = simulate(plan, model=ImuModel(), noise=ImuNoise(), site=site, rate=DRAWN_AT)
        log = drawn.log if self.gyro else replace(drawn.log, gyro=None)
        again = hand_rotated.again_of(own)
        sizes = left_out.whole(self.given.sizes, site, again.white, again.wander)
        out = []
        together = TOGETHER if sizes is None else len(steps)
        for begin in range(0, len(steps), together):
            some = slice(2 * begin, 2 * min(begin + together, len(steps)) + 1)
            session = Session.reduce(log, drawn.first[some], drawn.last[some], site)
            start = Attitudes(ImuModel(), plan.C_nb[some])
            noise = replace(own.noise, slow=ImuNoise())
            model = replace(own, session=session, start=start, noise=noise)
            at = model.linearise(start)
            more = () if sizes is None else left_out.columns(
                own.layout.names, site, {g: v for g, v in sizes.items() if "drift" not in g},
                hand_rotated.again_of(model))(start)  # fmt: skip
            causes = {s.name: s.shared for s in (*at.sources, *more) if _is_place(s)}
            r, d, _ = at.jacobian.shape
            B = [np.zeros((r, d, k)) if causes.get(name) is None else size * causes[name]
                 for name, size, k in tied]  # fmt: skip
            each = [s for s in at.sources if not _is_place(s)]
            both = np.concatenate([at.jacobian, *B], axis=2)
            J = mixed.Covariance(each, reached.sds, (r, d), np.ones(r)).whiten(both)
            J, n = J.reshape(r, d, -1), len(start.C_nb)
            shared = at.jacobian.shape[2] + np.arange(sum(k for *_, k in tied))
            for j in range(n // 2):  # rest, its rate, and the turn to it
                rows = [2 * j + 1, *([n + 2 * j + 1, 2 * n + 2 * j] if self.gyro else [])]
                columns = np.concatenate([np.arange(p), p + 6 * j + np.arange(6), shared])
                out.append(J[rows][:, :, columns])
        return np.array(out)

    def everything(self, log: Log, first: IntArray, last: IntArray, reached: Reached) -> Reached:
        # One more rest in every orientation: what is left out and this does not lower, none does.
        C = reached.C_nb[-1]
        turned = (
            (up, C_n := _upright(up), rotation_vector(C.T @ C_n)) for up in named_directions()
        )
        steps = [Step("rest", up, 2 * self.hold, C_n, turn) for up, C_n, turn in turned]
        plan = out_and_back(C, steps)
        drawn = simulate(plan, model=reached.state.model, noise=ImuNoise(), site=self.given.site,
                         rate=1.0 / log.interval, sampled=log.sampled)  # fmt: skip
        n, begun = len(log), float(log.time[-1] + log.interval)
        more = drawn.log
        gyro = None if log.gyro is None or more.gyro is None else np.append(log.gyro, more.gyro, 0)
        assert log.accel is not None
        assert more.accel is not None
        whole = replace(log, time=np.append(log.time, begun + more.time), gyro=gyro,
                        accel=np.append(log.accel, more.accel, 0), temperature=None)  # fmt: skip
        first, last = np.append(first, n + drawn.first), np.append(last, n + drawn.last)
        data = Session.reduce(whole, first, last, self.given.site)
        start = Attitudes(reached.state.model, np.concatenate([reached.C_nb, plan.C_nb]))
        model = replace(reached.model, session=data, start=start)
        own = CoefficientVector.prior(model.layout, self.given.prior)
        again = hand_rotated.again_of(model)
        fit, judged = left_out.planned(
            model, own, self.given.sizes, self.given.site, again, reached.sds
        )
        return Reached.of_fit(fit, judged, model, own, start.C_nb)


def _is_place(source: mixed.Source) -> bool:
    """Tell whether a cause is shared by readings wherever they are in time."""
    timed = "drift" in source.name or source.name.startswith("slow noise")
    return source.shared is not None and source.each is None and not timed


def _upright(up: FloatArray) -> FloatArray:
    """Return an attitude with `up` (3,) up and its most level axis ahead, shape (3, 3) [1]."""
    C = aligning(up, UP)
    level = C @ np.eye(3)[int(np.argmin(np.abs(up)))]
    return exp(np.arctan2(level[0], level[1]) * UP) @ C


def out_and_back(C_nb: FloatArray, steps: list[Step]) -> RestPlan:
    """Return a plan from `C_nb` (3, 3) [1] to each of `steps` and back."""
    attitudes, turns = [C_nb], []
    for step in steps:
        assert step.C_nb is not None
        assert step.rotation is not None
        attitudes += [step.C_nb, C_nb]
        turns += [step.rotation, -step.rotation]
    rotation = np.array(turns)
    seconds = np.full(len(attitudes), steps[0].seconds)
    return RestPlan(np.array(attitudes), seconds, turn_time(rotation), rotation)
