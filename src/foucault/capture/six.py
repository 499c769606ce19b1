"""Rests on six faces: what those so far have shown, and which face would show most next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.capture.step import Begun, Reached, Step
from foucault.coefficients import CoefficientVector
from foucault.detect.faces import OFF_FACE, Faces, face_readings
from foucault.errors import FoucaultError
from foucault.estimate.faces import FaceNoise, OnFaces, Scene, State
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import ImuModel
from foucault.models.rests_and_turns import SIX, FaceReadings
from foucault.procedures import left_out, on_faces
from foucault.procedures.on_faces import Observed
from foucault.tables import Log

EYE = np.eye(3)


class OnSix(Begun):
    """What a session on six faces has shown, and what it could show next."""

    def first_step(self) -> Step:
        return Step("rest", EYE[2], self.hold, EYE)

    def reached(self, log: Log, first: IntArray, last: IntArray) -> Reached | None:
        site = self.given.site
        readings, tilt = face_readings(log, first, last, site.gravity)
        on = np.flatnonzero(tilt <= OFF_FACE)
        if not len(on):
            return None
        gyro = None if readings.gyro is None else readings.gyro[on]
        some = FaceReadings(readings.up_k[on], readings.accel[on], gyro, readings.start[on],
                            readings.time[on], readings.group[on])  # fmt: skip
        faces = Faces(some, first[on], last[on], tilt[on], None, np.zeros(len(on), bool))
        tilts = (self.given.settings.placement_sd, 0.0, 0.0)
        seen = {(int(a), int(s)) for a, s in zip(some.axis, some.sign, strict=True)}
        if len(seen) == len(SIX):
            try:
                model = Observed(log, faces, None, self.wanted.names, tilts).model(self.given)
                own = CoefficientVector.prior(model.layout, self.given.prior)
                again = on_faces.again(model, log)
                fit, judged = left_out.fit(model, own, self.given.sizes, site, again)
                if np.isfinite(fit.estimate.coefficients.sd).all():
                    return Reached.of_fit(fit, judged, model, own, EYE[None])
            except (FoucaultError, np.linalg.LinAlgError):
                pass  # what contradicts them is said when the session is calibrated
        noise = on_faces.noise_of(log, faces, None, self.given.noise)
        scene = self._scene(some)
        model = OnFaces(scene, self.wanted.layout, State(ImuModel(), EYE), noise, tilts)
        size = self.given.settings.placement_sd
        sds = {"placement": on_faces.PLACED if size is None else size}
        return Reached.foreseen(model, sds, self.prior, EYE[None])

    def _scene(self, rests: FaceReadings) -> Scene:
        site, none = self.given.site, np.zeros((0, 3))
        vertical = 0.0 if site.latitude is None else EARTH_RATE * np.sin(site.latitude)
        return Scene(rests, None, site, site.gravity * rests.up_k, vertical * rests.up_k, none,
                     none, np.zeros((0, 3, 3)))  # fmt: skip

    def candidates(self, reached: Reached) -> list[Step]:
        # Two opposite faces show what neither shows alone: what is best by one step is not enough.
        r = reached.model.scene.rests
        seen = {(int(a), int(s)) for a, s in zip(r.axis, r.sign, strict=True)}
        left = [face for face in SIX if face not in seen] or SIX
        faces = [sign * EYE[axis] for axis, sign in left]
        return [Step("rest", up, self.hold) for up in faces]

    def after(self, reached: Reached, steps: list[Step]) -> FloatArray:
        # What is left out is as large after one more rest: only `everything` counts it.
        model, prior, sds = reached.model, reached.prior, reached.sds
        every = [model, *(self._with(model, [s]) for s in steps)]
        sd = np.array([Reached.foreseen(m, sds, prior, EYE[None]).sd for m in every])
        return np.asarray(reached.sd * sd[1:] / sd[0])

    def _with(self, model: OnFaces, steps: list[Step]) -> OnFaces:
        """Return the model of the same session with more rests; what they read does not matter."""
        r, k = model.scene.rests, len(steps)
        up = np.array([s.up for s in steps])
        seconds = np.array([s.seconds for s in steps])
        begun = r.start[-1] + r.time[-1] + np.cumsum(seconds)
        gyro = None if r.gyro is None else np.append(r.gyro, np.zeros((k, 3)), 0)
        rests = FaceReadings(
            np.append(r.up_k, up, 0), np.append(r.accel, np.zeros((k, 3)), 0), gyro,
            np.append(r.start, begun), np.append(r.time, seconds),
            np.append(r.group, r.group.max() + 1 + np.arange(k)),
        )  # fmt: skip
        scene = self._scene(rests)
        source = "declared" if self.given.noise is not None else "measured"
        noise = FaceNoise.sampled(model.noise.session, rests, None, source)  # type: ignore[arg-type]
        return replace(model, scene=scene, noise=noise)

    def everything(self, log: Log, first: IntArray, last: IntArray, reached: Reached) -> Reached:
        # Four more rests on every face.
        more = [Step("rest", sign * EYE[axis], 2 * self.hold) for axis, sign in SIX] * 4
        model = self._with(reached.model, more)
        site, own = self.given.site, reached.prior
        again = on_faces.again(model, log)
        fit, judged = left_out.planned(model, own, self.given.sizes, site, again, reached.sds)
        return Reached.of_fit(fit, judged, model, own, EYE[None])
