"""The tables of a transfer alignment, and what it cannot see in principle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.diagnose.transfer import stretches as transfer_stretches
from foucault.diagnose.transfer.checks import Evidence
from foucault.estimate.ins_filter import seen_at_place
from foucault.estimate.linear_filter import LinearSmoothed
from foucault.estimate.transfer.fit import HandOver, Transfer
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
    undelayed: Transfer | None,
) -> dict[str, TableData]:
    """Return the tables of the report.

    `backward` or None: the run as seen from its end; `undelayed` or None: the same run, had the
    delay been ignored.
    """
    out = {"innovations": _innovations(e), "estimates": estimates(e.found, names)}
    if backward is not None:
        out |= {"smoothed": _smoothed(e, backward), "delayed": _delayed(e, backward)}
    if undelayed is not None:
        both = [name for name in names if name in undelayed.free.layout]
        out["undelayed"] = estimates(undelayed, both)
    if np.isfinite(e.found.run.margin).any():
        out["gamma"] = {"time": e.found.free.time, "margin": e.found.run.margin}
    made: dict[str, TableData] = {n: _thinned(table, MOST[n]) for n, table in out.items()}
    layout = e.found.free.layout
    sd = {name: e.found.run.sd[:, layout.index(name)] for name in names}
    made["stretches"] = transfer_stretches.table(e.master[e.found.free.used], sd)
    if e.fit is not None:
        made["likelihood"] = {"delay": e.fit.tried, "log_likelihood": e.fit.log_likelihood}
    if e.delay is not None:
        d = e.delay
        made["delay_parts"] = {"start": d.part_start, "end": d.part_end, "delay": d.part_delay,
                               "delay_sd": np.sqrt(np.diag(d.part_cov))}  # fmt: skip
    return made


def _thinned(table: Table, most: int) -> Table:
    step = -(-len(table["time"]) // most)
    return {name: column[::step] for name, column in table.items()}


def _innovations(e: Evidence) -> Table:
    run, out = e.found.run, {"time": e.found.free.time}
    for i, name in enumerate(CHANNELS):
        if np.isfinite(run.variance[:, i]).any():
            out |= {name: run.innovation[:, i], f"{name}_sd": np.sqrt(run.variance[:, i])}
    return out | {"nis": run.nis}


def estimates(found: Transfer, names: Iterable[str]) -> Table:
    """Return coefficients along the run with their standard deviations."""
    layout, run = found.free.layout, found.run
    out = {"time": found.free.time}
    for name in names:
        i = layout.index(name)
        out |= {name: found.point[i - 9] + run.states[:, i], f"{name}_sd": run.sd[:, i]}
    return out


def _smoothed(e: Evidence, backward: LinearSmoothed) -> Table:
    """Return attitude and position of the slave as seen from the end, and sds of the attitude."""
    free = e.found.free
    history = corrected(free.history, np.ascontiguousarray(backward.states[:, :9]))
    states = states_of(history)
    A = seen_at_place(history)[:, :3]
    cov = A @ backward.cov[:, :9, :9] @ np.swapaxes(A, 1, 2)
    sd = np.sqrt(np.maximum(np.einsum("kii->ki", cov), 0.0))  # of a run that went astray too
    heading, pitch, roll = angles_of(states["C_nb"]).T
    return {
        "time": e.slave.increments.time[free.rows], "latitude": states["latitude"],
        "longitude": states["longitude"], "heading": heading, "pitch": pitch, "roll": roll,
        "phi_east_sd": sd[:, 0], "phi_north_sd": sd[:, 1], "phi_up_sd": sd[:, 2],
    }  # fmt: skip


def _delayed(e: Evidence, backward: LinearSmoothed) -> Table:
    """Return how the slave has gone on between validity and arrival of each message."""
    free = e.found.free
    history = corrected(free.history, np.ascontiguousarray(backward.states[:, :9]))
    states, time = states_of(history), e.slave.increments.time[free.rows]
    heading = np.unwrap(angles_of(states["C_nb"])[:, 0])
    v, arrival = states["velocity_n"], e.master.time[free.used]
    gone = {
        name: np.interp(arrival, time, x) - np.interp(free.time, time, x)
        for name, x in (("heading", heading), ("velocity_east", v[:, 0]),
                        ("velocity_north", v[:, 1]))
    }  # fmt: skip
    inside = arrival <= time[-1]
    return {"time": arrival[inside]} | {name: x[inside] for name, x in gone.items()}


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
