"""A slave beside its master: stretches of motion, causes of disagreement, and the report.

Judge a transfer alignment: does what was said of mount and messages explain what was seen?

How innovations are judged is `infer.filtered.components`.

The tables of a transfer alignment: what was found, what the vehicle did, what it cannot show.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import check, prior_check, status_check
from foucault.diagnose.fit_checks import held_out_check
from foucault.errors import Status
from foucault.estimate.delay import Delay
from foucault.estimate.transfer import DelayFit, HandOver, TransferFit, TransferModel
from foucault.infer.filtered import components, dependence, parts_out
from foucault.infer.gauss_newton import FALSE_ALARM, Component
from foucault.infer.linear_filter import LinearRun, LinearSmoothed, conditional
from foucault.kernels.ins_filter import corrected
from foucault.models.rotation import angles_of, exp, turned
from foucault.models.rotation import log as rotation_vector
from foucault.models.transfer import Messages, Mount
from foucault.navigate.increments import Increments
from foucault.navigate.ins_filter import seen_at_place
from foucault.navigate.strapdown import states_of
from foucault.result import Check, TableData

EACH = FALSE_ALARM / 4  # False-alarm rate of each of four tests, so that all together keep 1 % [1].
BLOCKS = 6  # The messages are predicted in so many parts, each from all others [1].

HARDLY = 0.7
"""A coefficient whose uncertainty is more than this of what it was before is hardly seen [1]."""

NEAR = 2e-3  # A delay below this is none [s].


@dataclass(frozen=True)
class Evidence:
    """Everything the checks look at."""

    model: TransferModel
    fit: TransferFit  # the model solved by the filter that was chosen
    # what was known of the coefficients and of what is found besides [SI]
    prior: CoefficientVector
    status: Status  # how the passes ended
    delay: Delay | None  # what rate matching has found
    longest: float  # end of the bracket of the delay [s]
    likeliest: DelayFit | None  # the likeliest delay, where it was looked for
    aside: tuple[str, ...]  # groups of coefficients that the motion need not show

    @cached_property
    def states(self) -> CoefficientVector:
        """What was found of `prior`, with covariance [SI]."""
        return self.model.estimate(self.fit, self.prior)


def spreads(e: Evidence) -> dict[str, Component]:
    """Return the innovations of velocities and of attitudes against what is expected of them."""
    return components(e.fit, EACH)


def innovations(e: Evidence) -> dict[str, Any]:
    """Return the innovations of velocities and attitudes in numbers, for result.json."""
    u = e.fit.run.white
    axes = np.sqrt(np.nansum(u**2, axis=0) / np.maximum(np.isfinite(u).sum(axis=0), 1))
    return {
        name: dict(zip(("ratio", "low", "high"), s.rms, strict=True))
        | {
            "count": s.count,
            "independent": s.redundancy,
            "axes": axes[e.model.kinds[name]].tolist(),
        }
        for name, s in spreads(e).items()
    }


def fits(e: Evidence) -> bool:
    """Tell whether no innovations are larger than they may be."""
    return all(s.chi_square <= s.high for s in spreads(e).values())


def checks(e: Evidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    miss = (e.states.values - e.prior.values) / e.prior.prior_sd
    return (
        status_check(e.status, ()), *(_innovations(e, *item) for item in spreads(e).items()),
        _white(e), *_held_out(e), prior_check(e.states, miss), _seen(e), *_bracket(e),
    )  # fmt: skip


def bracket(e: Evidence) -> tuple[float, float] | None:
    """Return limits [s] of an expected delay, as well as it is known; None where it is given."""
    if "master.delay" not in e.states.layout:
        return None
    margin = 3.0 * float(e.states["master.delay"].sd[0])
    return -margin - NEAR, e.longest + margin


def _bracket(e: Evidence) -> tuple[Check, ...]:
    limits = bracket(e)
    if limits is None:
        return ()
    low, high = (1e3 * edge for edge in limits)
    given = {"longest": 1e3 * e.longest}
    return (check("delay of messages", "delay", 1e3 * e.states.value("master.delay"), low, high,
                  given),)  # fmt: skip


def _innovations(e: Evidence, name: str, s: Component) -> Check:
    rms, low, high = s.rms
    return check("innovations of messages", f"{name} innovations", rms,
                 low if e.fit.nominal else None, high, {"name": name})  # fmt: skip


def whiteness(run: LinearRun) -> tuple[float, float]:
    """Return how much innovations depend on those before them, and what is allowed [1]."""
    return dependence(run, EACH)


def _white(e: Evidence) -> Check:
    worst, limit = whiteness(e.fit.run)
    return check("whiteness", "whiteness", worst, None, limit)


def _held_out(e: Evidence) -> tuple[Check, ...]:
    """Predict parts of the messages that the filter has not followed, from before and after."""
    time = e.fit.system.time
    if not np.isfinite(e.fit.run.states).all():
        return ()
    edges = np.linspace(0, len(time), BLOCKS + 1).astype(int)
    found = parts_out(e.fit, edges, EACH)
    if not found.count:
        return ()
    begin, end = time[edges[found.worst]], time[edges[found.worst + 1] - 1]
    return (held_out_check(found, "messages", f", worst from {begin:.0f} to {end:.0f} s"),)


def hardly(e: Evidence) -> tuple[str, ...]:
    """Return the coefficients that the motion shows hardly anything of.

    What the motion shows, and what is only counted with hides again, is `hidden`.
    """
    return unknown(e.states, e.aside, motion=True)


def hidden(e: Evidence) -> list[str]:
    """Return the coefficients that the motion shows, were it not for what is counted with."""
    unseen = hardly(e)
    return [n for n in unknown(e.states, e.aside, motion=False) if n not in unseen]


def unknown(c: CoefficientVector, aside: tuple[str, ...], *, motion: bool) -> tuple[str, ...]:
    """Return the coefficients that are hardly better known than before.

    `c`: with covariance and prior [SI]; `aside`: groups that are only counted with; `motion`: as
    if these were known.
    """
    assert c.cov is not None
    others = [i for i, n in enumerate(c.names) if n.startswith(aside)]
    sd = np.sqrt(np.maximum(np.diag(conditional(c.cov, others) if motion else c.cov), 0.0))
    return tuple(n for n, s, p in zip(c.names, sd, c.prior_sd, strict=True)
                 if s > HARDLY * p and not n.startswith(aside))  # fmt: skip


def _seen(e: Evidence) -> Check:
    names = hardly(e)
    return check("seen in the motion", "seen", float(len(names)), None, 0.0,
                 {"names": ", ".join(names)})  # fmt: skip


KINDS = ("straight", "accelerated", "turning")  # What a stretch is called.
OVER = 2.0  # Rates are means over so long [s].
TURNING, ACCELERATED = np.radians(1.0), 0.2  # More is a turn [rad/s], a change of speed [m/s^2].
SHORTEST = 4.0  # What lasts shorter belongs to the stretch before it [s].


def kinds_of(said: Messages) -> IntArray:
    """Return what the vehicle does at each message, as a number of `KINDS`, shape (k,)."""
    t = said.time
    a = np.searchsorted(t, t - OVER / 2)
    b = np.minimum(np.searchsorted(t, t + OVER / 2), len(t) - 1)
    dt = np.maximum(t[b] - t[a], 1e-9)
    C, speed = said.C_nm, np.linalg.norm(said.velocity_n, axis=1)
    rate = np.linalg.norm(rotation_vector(np.swapaxes(C[a], 1, 2) @ C[b]), axis=1) / dt
    out = np.where(np.abs(speed[b] - speed[a]) / dt > ACCELERATED, 1, 0)
    return np.where(rate > TURNING, 2, out).astype(np.int64)


def stretches(said: Messages) -> list[tuple[int, int, int]]:
    """Return first message, the one after the last, and kind of each stretch."""
    kind, t = kinds_of(said), said.time
    edges = np.flatnonzero(np.diff(kind, prepend=-1, append=-1))
    out: list[tuple[int, int, int]] = []
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        short = t[b - 1] - t[a] < SHORTEST
        if out and (short or out[-1][2] == kind[a]):
            out[-1] = (out[-1][0], b, out[-1][2])
        else:
            out.append((a, b, int(kind[a])))
    return out


def table(said: Messages, sd: Mapping[str, FloatArray]) -> dict[str, npt.NDArray[Any]]:
    """Return a row per stretch, with `sd` (k,) of each coefficient at its end [SI]."""
    found = stretches(said)
    first = np.array([a for a, _, _ in found])
    last = np.array([b for _, b, _ in found]) - 1
    C, speed = said.C_nm, np.linalg.norm(said.velocity_n, axis=1)
    turned = rotation_vector(np.swapaxes(C[first], 1, 2) @ C[last])
    return {
        "start": said.time[first],
        "end": said.time[last],
        "kind": np.array([KINDS[kind] for _, _, kind in found]),
        "turn": np.linalg.norm(turned, axis=1),
        "speed": speed[last] - speed[first],
        **{f"{name}_sd": x[last] for name, x in sd.items()},
    }


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
    """Return the tables; `backward`: the run from its end; `undelayed`: had there been no delay."""
    system, run = e.fit.system, e.fit.run
    out = {"innovations": _innovation_table(e), "estimates": estimates(e, names)}
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
    made["stretches"] = table(e.model.master[system.used], sds)
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


def _innovation_table(e: Evidence) -> Table:
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
    """Return how the slave is turned on its master, with what was `found`, for result.json."""
    C_ms = mount.C_ms @ exp(found["installation"].values)
    return {
        "C_ms": C_ms.tolist(),
        "angles": turned(angles_of(C_ms)).tolist(),
        "nominal": turned(angles_of(mount.C_ms)).tolist(),
        "lever_arm": mount.lever_m.tolist(),
    }


def unseen(mount: Mount, *, left_out: bool = True, misalignments: bool = False) -> list[str]:
    """Say what cannot be seen in principle, for result.json; `left_out` is counted with."""
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
