"""How two bodies are tied, in the form of others: what calibrations of two bodies found.

Each form says in words which way it goes: a rotation or a lever arm that is read the other way
round fits nothing, and looks as good.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.export.request import EXPORTED, number, usable
from foucault.models.rotation import exp
from foucault.result import Result

MADE = f"# {EXPORTED.decode()}"


@dataclass(frozen=True)
class Tie:
    """Another body beside a reference body: ``x_other = C x_reference``."""

    reference: str  # body, with its frame in a transform of ROS
    other: str
    C: FloatArray  # (3, 3) [1]
    lever: FloatArray  # (3,) from the reference to the other, axes of the reference [m]
    delay: float  # what is added to a stamp of the other, for the clock of the reference [s]
    attitude: bool = True  # whether the rotation is known

    @property
    def to_other(self) -> FloatArray:
        """Points of the reference as the other sees them, shape (4, 4)."""
        return _matrix(self.C, -self.C @ self.lever)

    @property
    def to_reference(self) -> FloatArray:
        """Points of the other as the reference sees them, shape (4, 4)."""
        return _matrix(self.C.T, self.lever)

    @property
    def quaternion(self) -> FloatArray:
        """Axes of the other to those of the reference: x, y, z, w, shape (4,) [1]."""
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_matrix(self.C.T).as_quat())


def _matrix(C: FloatArray, p: FloatArray) -> FloatArray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = C, p
    return out


def ties(result: Result) -> list[Tie]:
    """Return how the bodies of a result are tied; none where it is of one body."""
    c, said = result.coefficients, result.diagnostics
    if result.procedure == "two_imus":
        got = said["imus"]
        rows = zip(got["C_cb"], got["lever_b"], got["tau"], strict=True)
        return [Tie("imu0", f"imu{k}", np.array(C), np.array(r), float(tau))
                for k, (C, r, tau) in enumerate(rows, 1)]  # fmt: skip
    if result.procedure == "imu_pose":
        seen = "pose.rotation.x" in c.layout
        C = exp(c["pose.rotation"].values).T if seen else np.eye(3)
        return [Tie("imu", "tracked", C, c["pose.lever"].values, c.value("pose.delay"), seen)]
    return []


def text(result: Result, form: str, force: bool) -> str:
    """Return the ties of a result in one of `FORMS`."""
    usable(result, force)
    found = ties(result)
    if not found or (form == "kalibr-chain" and result.procedure != "two_imus"):
        raise error("export.no_ties", form=form, procedure=result.procedure)
    if not all(t.attitude for t in found):
        raise error("export.no_rotation", form=form)
    return FORMS[form](found)


def _rows(T: FloatArray) -> str:
    return "\n".join(f"  - [{', '.join(number(v) for v in row)}]" for row in T)


def _chain(found: list[Tie]) -> str:
    out = [MADE, "# Kalibr, imu_chain: T_i_b takes points of imu0 to those of imu_i;",
           "# stamp of imu_i + time_offset = time of imu0. Topics and noise are to be filled in.",
           "imu0:", "  T_i_b:", _rows(np.eye(4)), "  time_offset: 0.0"]  # fmt: skip
    for t in found:
        out += [f"{t.other}:", "  T_i_b:", _rows(t.to_other), f"  time_offset: {number(t.delay)}"]
    return "\n".join(out) + "\n"


def _transform(found: list[Tie]) -> str:
    out = [MADE, "# ROS 2, tf2: where the child is in the parent, and how it is turned",
           "# in it. Axes are those of the log that was calibrated."]  # fmt: skip
    for t in found:
        x, q = (" ".join(f"--{k} {number(v)}" for k, v in zip(keys, values, strict=True))
                for keys, values in (("xyz", t.lever), (("qx", "qy", "qz", "qw"), t.quaternion))
                )  # fmt: skip
        out.append(f"ros2 run tf2_ros static_transform_publisher {x} {q} "
                   f"--frame-id {t.reference} --child-frame-id {t.other}")  # fmt: skip
        out.append(f"# stamps of {t.other} + {number(t.delay)} s = time of {t.reference}")
    return "\n".join(out) + "\n"


def _hand_eye(found: list[Tie]) -> str:
    out = [MADE]
    for t in found:
        a, b = t.reference, t.other
        for name, T, words in (
            (f"T_{b}_{a}", t.to_other, f"p_{b} = T p_{a}: a point that {a} sees, as {b} sees it"),
            (f"T_{a}_{b}", t.to_reference, f"p_{a} = T p_{b}: a point that {b} sees, as {a} sees "
             f"it; its last column is where {b} sits in {a}"),
        ):  # fmt: skip
            out += [f"# {words}", f"{name}:", _rows(T)]
        out += [f"# stamp of {b} + delay = time of {a}", f"delay_{b}: {number(t.delay)}"]
    return "\n".join(out) + "\n"


FORMS = {"kalibr-chain": _chain, "ros2-tf": _transform, "hand-eye": _hand_eye}  # Receivers of ties.
