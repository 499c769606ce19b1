"""The tables of a transfer alignment, and what it cannot see in principle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.transfer import stretches as transfer_stretches
from foucault.diagnose.transfer.checks import Evidence
from foucault.estimate.ins_filter import seen_at_place
from foucault.estimate.transfer.hand_over import HandOver
from foucault.infer.linear_filter import LinearSmoothed
from foucault.kernels.ins_filter import corrected
from foucault.models.attitude import angles_of
from foucault.models.rotation import exp, turned
from foucault.models.transfer import Mount
from foucault.navigate.increments import Increments
from foucault.navigate.state import states_of
from foucault.result import TableData

Table = dict[str, npt.NDArray[Any]]

MOST = {
    "innovations": 3000,
    "estimates": 800,
    "undelayed": 800,
    "smoothed": 3000,
    "delayed": 3000,
    "gamma": 3000,
}
"""Rows that are kept of each table; of longer ones every second, third and so on [1]."""

CHANNELS = ("velocity_east", "velocity_north", "velocity_up",
            "attitude_1", "attitude_2", "attitude_3")  # fmt: skip


def tables(
    e: Evidence,
    names: Sequence[str],
    backward: LinearSmoothed | None,
    undelayed: Evidence | None,
) -> dict[str, TableData]:
    """Return the tables of the report.

    `backward` or None: the run as seen from its end; `undelayed` or None: the same run, had the
    delay been ignored.
    """
    system, run = e.fit.system, e.fit.run
    out = {"innovations": _innovations(e), "estimates": estimates(e, names)}
    if backward is not None:
        history = corrected(system.history, np.ascontiguousarray(backward.states[:, :9]))
        states, time = states_of(history), e.model.slave.increments.time[system.rows]
        sd = _attitude_sd(history, backward.cov[:, :9, :9])
        out["smoothed"] = {"time": time, **_place(states), **sd}
        out["delayed"] = _delayed(e, states, time)
    if undelayed is not None:
        both = [name for name in names if name in undelayed.model.layout]
        out["undelayed"] = estimates(undelayed, both)
    if not e.fit.nominal:
        out["gamma"] = {"time": system.time, "margin": run.margin}
    made: dict[str, TableData] = {n: _thinned(table, MOST[n]) for n, table in out.items()}
    sds = {name: run.sd[:, e.model.layout.index(name)] for name in names}
    made["stretches"] = transfer_stretches.table(e.model.master[system.used], sds)
    if e.likeliest is not None:
        tried, likely = e.likeliest.tried, e.likeliest.log_likelihood
        made["likelihood"] = {"delay": tried, "log_likelihood": likely}
    if e.delay is not None:
        d = e.delay
        made["delay_parts"] = {"start": d.part_start, "end": d.part_end, "delay": d.part_delay,
                               "delay_sd": np.sqrt(np.diag(d.part_cov))}  # fmt: skip
    return made


def _thinned(table: Table, most: int) -> Table:
    step = -(-len(table["time"]) // most)
    return {name: column[::step] for name, column in table.items()}


def _innovations(e: Evidence) -> Table:
    run, out = e.fit.run, {"time": e.fit.system.time}
    for i, name in enumerate(CHANNELS):
        if np.isfinite(run.variance[:, i]).any():
            out |= {name: run.innovation[:, i], f"{name}_sd": np.sqrt(run.variance[:, i])}
    return out | {"nis": run.nis}


def estimates(e: Evidence, names: Iterable[str]) -> Table:
    """Return coefficients along the run with their standard deviations."""
    out, point = {"time": e.fit.system.time}, e.model.values(e.fit.point)
    for name in names:
        i = e.model.layout.index(name)
        out |= {name: point[i - 9] + e.fit.run.states[:, i], f"{name}_sd": e.fit.run.sd[:, i]}
    return out


def _place(states: dict[str, FloatArray]) -> Table:
    angles = dict(zip(("heading", "pitch", "roll"), angles_of(states["C_nb"]).T, strict=True))
    return {"latitude": states["latitude"], "longitude": states["longitude"], **angles}


def _attitude_sd(history: FloatArray, cov: FloatArray) -> Table:
    A = seen_at_place(history)[:, :3]
    variance = np.einsum("kii->ki", A @ cov @ np.swapaxes(A, 1, 2))
    sd = np.sqrt(np.maximum(variance, 0.0))  # of a run that went astray too
    return {f"phi_{a}_sd": column for a, column in zip(("east", "north", "up"), sd.T, strict=True)}


def _delayed(e: Evidence, states: dict[str, FloatArray], time: FloatArray) -> Table:
    """Return how the slave has gone on between validity and arrival of each message."""
    v, arrival = states["velocity_n"], e.model.master.time[e.fit.system.used]
    heading = np.unwrap(angles_of(states["C_nb"])[:, 0])
    inside = arrival <= time[-1]
    out = {"time": arrival[inside]}
    for name, x in (("heading", heading), ("velocity_east", v[:, 0]), ("velocity_north", v[:, 1])):
        gone = np.interp(arrival, time, x) - np.interp(e.fit.system.time, time, x)
        out[name] = gone[inside]
    return out


def hand_over(handed: HandOver, increments: Increments) -> dict[str, Any]:
    """Return the state in which the slave goes on alone, for result.json."""
    s = handed.state
    return {
        "time": float(increments.time[handed.row]),
        "latitude": s.latitude, "longitude": s.longitude, "height": s.height,
        "velocity": s.velocity_n.tolist(),
        "heading": s.heading, "pitch": s.pitch, "roll": s.roll,
        "covariance": handed.cov[:6, :6].tolist(),
        "coefficients": {n: float(v) for n, v in zip(handed.coefficients.names,
                                                     handed.coefficients.values, strict=True)},
    }  # fmt: skip


def mounting(mount: Mount, found: CoefficientVector) -> dict[str, Any]:
    """Return how the slave is turned on its master, for result.json.

    `found`: the coefficients, those of the installation among them.
    """
    C_ms = mount.C_ms @ exp(found["installation"].values)
    return {
        "C_ms": C_ms.tolist(),
        "angles": turned(angles_of(C_ms)).tolist(),
        "nominal": turned(angles_of(mount.C_ms)).tolist(),
        "lever_arm": mount.lever_m.tolist(),
    }


def unseen(mount: Mount, *, left_out: bool = True, misalignments: bool = False) -> list[str]:
    """Say what this procedure cannot see in principle, for result.json.

    `left_out`: whether what is not in the result is counted with; `misalignments`: whether
    misalignments and scale factors are in the result.
    """
    out = [
        "Errors of the master: what it says is taken as true but for noise, and a bias of its "
        "heading is one of the installation.",
        "A local gravity that differs from the one assumed: 1 mGal is 1 ug in the bias of the "
        "accelerometer that points up. Its uncertainty is part of that of this bias, no more.",
        "A lever arm that is wrong: it is taken as exact.",
        "Biases from one switch-on to the next, and other temperatures than those of the run.",
    ]
    if left_out:
        out.append(
            "Gyros that read specific force: in level motion that is part of their biases. So are "
            "misalignments and scale factors of the accelerometers beside the biases of these. "
            "Their uncertainties count with the sizes that [prior] says, or with those of a "
            "tactical instrument."
        )
    else:
        some = "G-sensitivity of the gyros: it is" if misalignments else (
            "Misalignments of the slave, scale factors of its accelerometers and g-sensitivity of "
            "its gyros: they are"
        )  # fmt: skip
        out.append(
            f"{some} taken as none (left_out), and part of what is found. 1 mrad, or 1000 ppm, "
            "makes 1 mg in the biases of the accelerometers, 1 deg/h/g makes 1 deg/h in those of "
            "the gyros, of which their uncertainties know nothing."
        )
    if not mount.load and mount.flexure_sd == 0:
        out.append("A mount that bends: it is taken as rigid (load, flexure_sd).")
    return out
