"""Small sessions of every procedure, and what people do wrong with them.

A session is what a user has: a campaign file and a table of readings. A mistake changes one of the
two as the user would, and the command goes the whole way from the files to what it says.
"""

from __future__ import annotations

import io
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq

from foucault import campaign
from foucault.campaign import delay, navigation
from foucault.campaign.navigation import Window
from foucault.campaign.tables import Said
from foucault.campaign.writing import changed
from foucault.cli.watch import _open as open_watch
from foucault.diagnose.allan import measure_log
from foucault.errors import Finding, FoucaultError
from foucault.export.calibrated_log import calibrate_log
from foucault.logs.own import columns_of
from foucault.plans.manoeuvres import Rest, Start
from foucault.result import Level, Result
from foucault.simulate.motion import simulate_motion
from foucault.tables import Log
from make_navigation import NOISE

G = 9.80665
DEG = np.pi / 180
LATITUDE = 48.8462 * DEG
GYRO = ("gyro_x", "gyro_y", "gyro_z")
ACCEL = ("accel_x", "accel_y", "accel_z")
MAG = ("mag_x", "mag_y", "mag_z")

Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Outcome:
    """What came of a session: the error that ended it, or what it found."""

    error: str | None = None
    findings: frozenset[str] = frozenset()
    failed: frozenset[str] = frozenset()
    numbers: tuple[float, ...] = ()

    @property
    def said(self) -> frozenset[str]:
        """Everything that a user would notice; a note is among it."""
        return self.findings | self.failed | ({self.error} if self.error else set())


@dataclass(frozen=True)
class Session:
    """A campaign file, its readings, and the command that takes them."""

    text: str
    columns: Columns
    run: Callable[[Path], Outcome]
    master: Columns = field(default_factory=dict)
    spoil: Callable[[list[str]], list[str]] | None = None
    as_text: bool = False

    def with_keys(self, **tables: Mapping[str, Any]) -> Session:
        """Return the session with keys of its campaign changed."""
        return replace(self, text=changed(campaign.parse(self.text), tables, "changed"))

    def with_columns(self, **columns: np.ndarray) -> Session:
        """Return the session with other readings."""
        return replace(self, columns={**self.columns, **columns})

    def rows(self, keep: np.ndarray) -> Session:
        """Return the session with these rows, numbers or a mask."""
        return replace(self, columns={k: v[keep] for k, v in self.columns.items()})

    def triad(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return those of the columns that it has."""
        single = {GYRO: ("gyro",), ACCEL: ("specific force",)}
        return names if names[0] in self.columns else single[names]

    def write(self, folder: Path) -> Path:
        """Write its files; returns the campaign."""
        file = "log.csv" if self.as_text or self.spoil else "log.parquet"
        table = pa.table(self.columns)
        if file == "log.parquet":
            pq.write_table(table, folder / file)
        else:
            text = io.BytesIO()
            pacsv.write_csv(table, text, pacsv.WriteOptions(quoting_style="none"))
            lines = text.getvalue().decode().splitlines()
            lines = self.spoil(lines) if self.spoil else [*lines, ""]
            (folder / file).write_text("\n".join(lines))
        if self.master:
            beside = tomllib.loads(self.text)["master"]["file"]
            pacsv.write_csv(pa.table(self.master), folder / beside)
        path = folder / "campaign.toml"
        path.write_text(self.text.replace('"log.csv"', f'"{file}"', 1))
        return path

    def go(self, folder: Path) -> Outcome:
        """Write the files and run the command."""
        try:
            return self.run(self.write(folder))
        except FoucaultError as problem:
            return Outcome(problem.code)


# -- what is done with a session -----------------------------------------------------------------


def _codes(findings: tuple[Finding, ...]) -> frozenset[str]:
    return frozenset(item.code for item in findings)


def _calibrate(path: Path) -> Outcome:
    result = campaign.calibrate(path)
    failed = {check.name for check in result.checks if not check.passed}
    if result.verdict.level is not Level.PASS:
        failed.add("verdict")
    return Outcome(None, _codes(result.findings), frozenset(failed),
                   tuple(result.coefficients.values))  # fmt: skip


def _align(path: Path) -> Outcome:
    found = navigation.align(path, Said(), Window(gyro_bias_sd=0.02 * DEG / 3600))
    angles = tuple(float(x) for one in found.found for x in one.angles)
    return Outcome(None, _codes(found.findings), numbers=angles)


def _navigate(path: Path) -> Outcome:
    found = navigation.run(path)
    failed = {check.name for check in found.checks if not check.passed}
    return Outcome(None, _codes(found.findings), frozenset(failed))


def _allan(path: Path) -> Outcome:
    log = campaign.read_log(campaign.load(path))
    seen = measure_log(log)
    return Outcome(None, _codes((*log.findings, *seen.findings)))


def _delay(path: Path) -> Outcome:
    found = delay.run(path)
    return Outcome(None, _codes(found.findings), numbers=(found.delay.delay,))


@cache
def _calibrated() -> Result:
    with TemporaryDirectory() as folder:
        return campaign.calibrate(session("hand_rotated").write(Path(folder)))


def _apply(path: Path) -> Outcome:
    read = campaign.load(path)
    out = path.parent / "calibrated.parquet"
    done = calibrate_log(_calibrated(), read.imu_log, read.folder, out)
    return Outcome(None, _codes(done.findings))


def _watch(path: Path) -> Outcome:
    session = open_watch(path, False, 1.0, None)
    while session.step():
        pass
    seen = session.finish()
    return Outcome(None, frozenset() if seen is None else _codes(seen.findings))


# -- the sessions --------------------------------------------------------------------------------

_QUICK: dict[str, dict[str, dict[str, Any]]] = {
    "hand_rotated": {"simulate": {"rests": 14, "rest_time": "2 s", "turn_time": "1.5 s",
                                  "first_rest_time": "3 s", "rate": "50 Hz"}},
    "six_position": {"simulate": {"rest_time": "3 s", "move_time": "1.5 s", "rate": "50 Hz",
                                  "placement_sd": "0 arcmin"}},
    "ferraris": {"simulate": {"rest_time": "3 s", "move_time": "1.5 s", "turn_time": "3 s",
                              "rate": "50 Hz"}},
    "norm_observation": {"procedure": {"spin_rate": "30 deg/s"},
                         "simulate": {"rest_time": "10 s", "turns": 1, "rate": "10 Hz"}},
    "turntable": {"procedure": {"spin_rate": "30 deg/s"},
                  "simulate": {"rest_time": "10 s", "turns": 1, "rate": "10 Hz"}},
    "rate_table": {"simulate": {"rates": ["20 deg/s", "-20 deg/s", "60 deg/s", "-60 deg/s"],
                                "step_time": "8 s", "rate": "10 Hz"}},
    "magnetometer": {"procedure": {"intensity": "49 uT", "gyro_bias_sd": "20 deg/h"},
                     "simulate": {"time": "20 s", "rate": "50 Hz"}},
    "continuous_spin": {"simulate": {"rates": ["290 deg/s", "-460 deg/s"], "spin_time": "5 s"}},
    "north_seeking": {},
    "platform_tumble": {"procedure": {"plan": "-x -z -y +z", "rate": "5 deg/s",
                                      "segment": "60 s", "average": "10 s", "passes": 4}},
    "systematic": {"procedure": {"passes": 2}, "simulate": {"rest_time": "30 s", "rate": "10 Hz"}},
    "transfer_alignment": {"simulate": {"rate": "25 Hz", "message_rate": "2 Hz",
                                        "with_outage": False}},
    "imu_pose": {"simulate": {"time": "20 s", "rate": "100 Hz", "pose_rate": "50 Hz"}},
    "two_imus": {"simulate": {"time": "20 s", "rate": "100 Hz"}},
}  # fmt: skip
"""Shorter than the templates: as much as each procedure needs to pass."""


def _simulated(name: str, folder: Path, words: dict[str, dict[str, Any]]) -> Session:
    read = campaign.parse(changed(campaign.parse(campaign.template(name)), words, "quick"))
    path = campaign.save_session(campaign.simulate(read), folder)
    file = folder / "log.csv"
    marked = file.read_text().startswith("#")
    columns = _arrays(pacsv.read_csv(file, pacsv.ReadOptions(skip_rows=int(marked))))
    beside = folder / tomllib.loads(path.read_text()).get("master", {}).get("file", "")
    own = beside.is_file() and beside.read_text().startswith("#")
    options = pacsv.ReadOptions(skip_rows=int(own))
    master = _arrays(pacsv.read_csv(beside, options)) if beside.is_file() else {}
    made = Session(path.read_text(), columns, _calibrate, master)
    if own:  # an IMU beside
        made = made.with_keys(master={
            "time": {"column": "time", "unit": "s"},
            "gyro": {"columns": list(GYRO), **RATES["gyro"]},
            "accel": {"columns": list(ACCEL), **RATES["accel"]},
        })  # fmt: skip
    if not marked:
        return replace(made, columns={k.partition(" (")[0]: v for k, v in columns.items()})
    made = _described(made, "sampled=increment" in file.read_text()[:80])
    return _declared(made, {"accel": {"first_rest": FIRST[name]}}) if name in FIRST else made


def _arrays(table: pa.Table) -> Columns:
    return {name: table[name].to_numpy() for name in table.column_names}


FIRST = {"norm_observation": "z up", "turntable": "z up", "rate_table": "x up"}
"""Orientation of the first rest, where templates do not say it."""

RATES = {"gyro": {"unit": "rad/s", "kind": "rate"}, "accel": {"unit": "m/s^2", "kind": "rate"}}
INCREMENTS = {"gyro": {"unit": "rad", "kind": "increment"},
              "accel": {"unit": "m/s", "kind": "increment"}}  # fmt: skip


def _described(made: Session, increments: bool) -> Session:
    """Describe the columns, so that units can be declared wrongly; sums where they are means."""
    says = {"time": {"column": "time", "unit": "s"}}
    for triad, names in (("gyro", GYRO), ("accel", ACCEL)):
        said = campaign.parse(made.text).tables.model_dump()["log"].get(triad) or {}
        first = {"first_rest": said["first_rest"]} if said.get("first_rest") else {}
        says[triad] = {"columns": list(names), **RATES[triad], **first}
    made = made.with_keys(log=says)
    return made if not increments else _as_increments(made)


def _as_increments(made: Session) -> Session:
    dt = _interval(made)
    sums = {name: made.columns[name] * dt for name in (*GYRO, *ACCEL)}
    return _declared(made.with_columns(**sums), INCREMENTS)


def _interval(made: Session) -> float:
    return float(np.median(np.diff(made.columns["time"])))


def _declared(made: Session, words: Mapping[str, Mapping[str, str]]) -> Session:
    """Return the session with other words in the blocks of [log]."""
    log = tomllib.loads(made.text)["log"]
    return made.with_keys(log={block: log[block] | said for block, said in words.items()})


@cache
def _resting() -> Log:
    """A navigation-grade instrument at rest for some minutes."""
    start = Start(LATITUDE, 2.3464 * DEG, 60.0, *np.radians([63.0, 3.0, -2.0]))
    return simulate_motion([Rest(120.0)], start, rate=10.0, noise=NOISE, seed=1).log


def _at_rest(run: Callable[[Path], Outcome]) -> Session:
    text = campaign.template("hand_rotated")
    made = Session(text, dict(columns_of(_resting())), run).with_keys(noise={"grade": "navigation"})
    bare = made.with_keys(log={"accel": {"columns": list(ACCEL), "unit": "m/s^2"}})
    return _described(bare, increments=False)


COMMANDS: dict[str, tuple[str, Callable[[Path], Outcome]]] = {
    "delay": ("transfer_alignment", _delay),
    "apply": ("hand_rotated", _apply),
    "watch": ("hand_rotated", _watch),
}
"""Commands that are tried with the session of a procedure."""

RESTING = {"align": _align, "navigate": _navigate, "allan": _allan}
"""Commands that are tried with a log at rest."""


def another(name: str, **simulate: Any) -> Session:
    """Return the session of a procedure with other words of [simulate], such as another seed."""
    quick = _QUICK[name]
    with TemporaryDirectory() as folder:
        changed_too = quick | {"simulate": quick.get("simulate", {}) | simulate}
        return _simulated(name, Path(folder), changed_too)


@cache
def session(name: str) -> Session:
    """Return the session of a procedure or command, made once."""
    if name in RESTING:
        return _at_rest(RESTING[name])
    if name in COMMANDS:
        of, run = COMMANDS[name]
        return replace(session(of), run=run, as_text=name == "watch")
    return another(name)


# -- what people do wrong ------------------------------------------------------------------------


def _scaled(made: Session, gyro: float = 1.0, accel: float = 1.0) -> Session:
    factors = {**dict.fromkeys(made.triad(GYRO), gyro), **dict.fromkeys(made.triad(ACCEL), accel)}
    return made.with_columns(**{k: made.columns[k] * f for k, f in factors.items()})


def _mag(made: Session, wrong: Callable[[np.ndarray], np.ndarray]) -> Session | None:
    """Spoil the readings of a magnetometer, where there is one."""
    if MAG[0] not in made.columns:
        return None
    spoilt = wrong(np.column_stack([made.columns[name] for name in MAG]))
    return made.with_columns(**{name: spoilt[:, k] for k, name in enumerate(MAG)})


PLACE, QUATERNION = ("x (m)", "y (m)", "z (m)"), ("qw", "qx", "qy", "qz")


def _pose(
    made: Session, wrong: Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, ...]]
) -> Session | None:
    """Spoil time, positions and quaternions of poses, where there are any."""
    if PLACE[0] not in made.master:
        return None
    names = ("time (s)", *PLACE, *QUATERNION)
    rows = np.column_stack([made.master[name] for name in names])
    time, p, q = wrong(rows[:, 0], rows[:, 1:4], rows[:, 4:])
    spoilt = np.column_stack([time, p, q])
    return replace(made, master={name: spoilt[:, k] for k, name in enumerate(names)})


SECOND = ("x2 (m)", "y2 (m)", "z2 (m)")


@cache
def _two_antennas() -> Session:
    return another("imu_pose", base=["0 m", "80 cm", "0 m"])


def _antennas(
    made: Session, wrong: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
    **keys: Mapping[str, Any],
) -> Session | None:  # fmt: skip
    """Spoil the positions of two antennas, of the same body beside the same IMU."""
    if PLACE[0] not in made.master:
        return None
    two = _two_antennas()
    both = (np.column_stack([two.master[n] for n in names]) for names in (PLACE, SECOND))
    p, q = wrong(*both)
    spoilt = dict(zip((*PLACE, *SECOND), [*p.T, *q.T], strict=True))
    return replace(two, master={"time (s)": two.master["time (s)"], **spoilt}).with_keys(**keys)


def _gone(x: np.ndarray) -> np.ndarray:
    """Lose an antenna for a second in six."""
    return np.where((np.arange(len(x)) % 300 < 50)[:, None], np.nan, x)


def _float(x: np.ndarray, seed: int) -> np.ndarray:
    """Let a third of positions be off by 30 cm."""
    rng = np.random.default_rng(seed)
    return x + 0.3 * (rng.uniform(size=(len(x), 1)) < 1 / 3) * rng.standard_normal(x.shape)


def _random() -> np.random.Generator:
    return np.random.default_rng(8)


def _upright(p: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Let the y axis of the poses' world be up: a quarter turn about x, by Hamilton's product."""
    w, x, y, z = q.T
    turned = np.column_stack([w + x, x - w, y + z, z - y]) / np.sqrt(2)
    return p[:, [0, 2, 1]] * [1.0, 1.0, -1.0], turned


def _held(t: np.ndarray, p: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """Hold the pose where tracking was lost: a second in six."""
    k = np.arange(len(t))
    at = np.where(k % 300 < 50, k // 300 * 300, k)
    return t, p[at], q[at]


def _lost_rows(made: Session) -> Session | None:
    """Lose one sample in a hundred of a log whose time is only counted."""
    if "[master]" not in made.text or made.run is not _calibrate or "transfer" in made.text:
        return None
    n = len(made.columns["time"])
    kept = np.sort(_random().permutation(n)[n // 100 :])
    return made.rows(kept).with_columns(time=made.columns["time"][: len(kept)])


def _one_cell(made: Session, value: float) -> Session:
    name = made.triad(ACCEL)[-1]
    spoilt = made.columns[name].copy()
    spoilt[len(spoilt) // 2] = value
    return made.with_columns(**{name: spoilt})


def _time_cell(made: Session, steps: float) -> Session:
    """Let one row be `steps` intervals after the one before."""
    time = made.columns["time"].astype(float)
    k = len(time) // 2 + 1
    time[k] = time[k - 1] + steps * (time[k + 1] - time[k - 1]) / 2
    return made.with_columns(time=time)


def _gap(made: Session) -> Session:
    n = len(made.columns["time"])
    return made.rows(np.r_[: n // 2, n // 2 + max(1, n // 50) : n])


def _doubled(made: Session) -> Session:
    n = len(made.columns["time"])
    return made.rows(np.insert(np.arange(n), n // 2, n // 2))


def _line(made: Session, change: Callable[[str], str], at: float = 0.5) -> Session:
    def spoil(lines: list[str]) -> list[str]:
        k = min(int(at * len(lines)), len(lines) - 1)
        return [*lines[:k], change(lines[k]), *lines[k + 1 :]]

    return replace(made, spoil=spoil)


def _axes(made: Session, gyro: np.ndarray | None = None, accel: np.ndarray | None = None
          ) -> Session | None:  # fmt: skip
    """Let the columns of a triad be those of `gyro` or `accel` times the right ones."""
    if GYRO[0] not in made.columns:
        return None
    out = {}
    for names, C in ((GYRO, gyro), (ACCEL, accel)):
        if C is not None:
            out |= dict(zip(names, C @ np.array([made.columns[n] for n in names]), strict=True))
    return made.with_columns(**out)


def _triads_exchanged(made: Session) -> Session | None:
    """Take the columns of the accelerometers for those of the gyros and the other way round."""
    if GYRO[0] not in made.columns or ACCEL[0] not in made.columns:
        return None
    names = zip((*GYRO, *ACCEL), (*ACCEL, *GYRO), strict=True)
    return made.with_columns(**{name: made.columns[other] for name, other in names})


def _part_reversed(made: Session) -> Session | None:
    """Command the second quarter of a tumble the other way round."""
    if "platform_tumble" not in made.text:
        return None
    n = len(made.columns["time"])
    sense = np.where((np.arange(n) >= n // 4) & (np.arange(n) < n // 2), -1.0, 1.0)
    return made.with_columns(**{k: made.columns[k] * sense for k in GYRO})


def _dead(made: Session, triad: tuple[str, ...]) -> Session:
    name = made.triad(triad)[-1]
    return made.with_columns(**{name: np.full(len(made.columns[name]), 0.0)})


def _stuck(made: Session) -> Session:
    """Let a gyro say its middle reading all the time."""
    name = made.triad(GYRO)[-1]
    x = made.columns[name].astype(float)
    return made.with_columns(**{name: np.full(len(x), np.median(x) or 1e-4)})


def _lost(made: Session) -> Session | None:
    """Let two gyros repeat their last reading from the middle on."""
    if GYRO[0] not in made.columns:
        return None
    out = {name: made.columns[name].astype(float) for name in GYRO[1:]}
    for x in out.values():
        x[len(x) // 2 :] = x[len(x) // 2]
    return made.with_columns(**out)


def _from_the_middle(made: Session, name: str) -> Session | None:
    """Let one sensor repeat its last reading from the middle on."""
    if not _sampled(made):
        return None
    x = made.columns[name].astype(float)
    x[len(x) // 2 :] = x[len(x) // 2]
    return made.with_columns(**{name: x})


def _repeated(made: Session, names: tuple[str, ...]) -> Session | None:
    """Let a triad repeat each reading four times, as where a log is faster than its sensor."""
    if not _sampled(made):
        return None
    rows = np.arange(len(made.columns["time"])) // 4 * 4
    return made.with_columns(**{name: made.columns[name][rows] for name in names})


def _sampled(made: Session) -> bool:
    """Tell whether the rows are samples, not means, and enough of them."""
    return GYRO[0] in made.columns and len(made.columns["time"]) > 400 and "dwell" not in made.text


def _spike(made: Session) -> Session | None:
    """Add 20 times its noise to one reading, where the instrument is quietest."""
    if not _sampled(made):
        return None
    x = made.columns[GYRO[2]].astype(float)
    step = np.abs(np.diff(x))
    scatter = np.convolve(step, np.ones(101), "same")
    k = 60 + int(np.argmin(scatter[60:-60]))
    size = 20 * np.median(step[k - 50 : k + 50]) / (0.6745 * 2**0.5)
    if size == 0:  # commands have no noise
        return None
    x[k] += size
    return made.with_columns(**{GYRO[2]: x})


def _empty(made: Session) -> Session | None:
    """Let the first row hold nothing, as some loggers write it before the first reading."""
    if not _sampled(made):
        return None
    out = {name: made.columns[name].astype(float) for name in (*GYRO, *ACCEL)}
    for x in out.values():
        x[0] = 0.0
    return made.with_columns(**out)


def _clipped(made: Session, triad: tuple[str, ...], part: float) -> Session:
    names = made.triad(triad)
    most = part * max(float(np.max(np.abs(made.columns[n]))) for n in names)
    return made.with_columns(**{n: np.clip(made.columns[n], -most, most) for n in names})


def _sums(made: Session) -> Session | None:
    """Sums over the interval, declared as rates."""
    if GYRO[0] not in made.columns:
        return None
    if 'kind = "increment"' in made.text:
        return _declared(made, RATES)
    return _scaled(made, _interval(made), _interval(made))


def _rates(made: Session) -> Session | None:
    """Rates, declared as sums over the interval."""
    if GYRO[0] not in made.columns:
        return None
    if 'kind = "increment"' in made.text:
        return _scaled(made, 1 / _interval(made), 1 / _interval(made))
    return _declared(made, INCREMENTS)


def _counts(made: Session) -> Session:
    return _scaled(made, 131.0 / DEG, 16384 / G)


def _site(made: Session, **keys: Any) -> Session:
    return made.with_keys(site=keys)


def _angles(made: Session, factor: float = 1.0, sense: float = 1.0) -> Session | None:
    """Change angles that are read beside the instrument: unit, or sense of the first."""
    if made.master:
        names = [n for n in made.master if n.endswith("(deg)") and "tude" not in n]
        if not names:
            return None
        out = {n: made.master[n] * factor for n in names}
        out[names[0]] = out[names[0]] * sense % (360.0 if factor == 1.0 else np.inf)
        return replace(made, master={**made.master, **out})
    names = [n for n in ("outer", "middle", "inner", "index") if n in made.columns]
    if not names or made.run is not _calibrate:
        return None
    out = {n: made.columns[n] * factor for n in names}
    out[names[0]] = out[names[0]] * sense
    return made.with_columns(**out)


def _exchanged(made: Session) -> Session | None:
    """Take latitude for longitude where a master says the place."""
    latitude, longitude = (
        next((n for n in made.master if n.startswith(word)), None) for word in ("lat", "lon")
    )
    if latitude is None or longitude is None:
        return None
    swapped = {latitude: made.master[longitude], longitude: made.master[latitude]}
    return replace(made, master={**made.master, **swapped})


def _site_exchanged(made: Session) -> Session:
    return _site(made, latitude="2.3464 deg", longitude="48.8462 deg")


def _master_late(made: Session) -> Session | None:
    """Let the master's clock be some seconds ahead."""
    if not made.master:
        return None
    name = next(n for n in made.master if n.startswith("time"))
    return replace(made, master={**made.master, name: made.master[name] + 8.0})


_PRIORS = {
    "six_position": "accel.scale", "platform_tumble": "accel.bias", "north_seeking": "gyro.bias",
    "magnetometer": "mag.bias",
}  # fmt: skip


def _contradicted(made: Session) -> Session | None:
    """State a coefficient some hundred times its stated sd off."""
    if made.run is not _calibrate:
        return None
    name = tomllib.loads(made.text)["procedure"]["name"]
    key = _PRIORS.get(name, "gyro.scale")
    mean, sd = {
        "gyro.bias": ("10 deg/h", "0.1 deg/h"), "accel.bias": ("10 mg", "0.1 mg"),
        "mag.bias": ("-100 uT", "1 uT"),
    }.get(key, ("20000 ppm", "100 ppm"))  # fmt: skip
    return made.with_keys(prior={key: {"mean": mean, "sd": sd}})


_SWAP = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
_CYCLE = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])

MISTAKES: dict[str, Callable[[Session], Session | None]] = {
    "missing": lambda s: _one_cell(s, np.nan),
    "infinite": lambda s: _one_cell(s, np.inf),
    "word": lambda s: _line(s, lambda line: line.rpartition(",")[0] + ",ERR"),
    "ragged": lambda s: _line(s, lambda line: line.rpartition(",")[0]),
    "cut off": lambda s: _line(s, lambda line: line[: len(line) // 2], 1.0),
    "gap": _gap,
    "same time": lambda s: _time_cell(s, 0.0),
    "backward": lambda s: _time_cell(s, -3.0),
    "twice": _doubled,
    "ms": lambda s: s.with_columns(time=s.columns["time"] * 1e3),
    "gyro deg": lambda s: _scaled(s, gyro=1 / DEG),
    "gyro rad": lambda s: _scaled(s, gyro=DEG),
    "accel g": lambda s: _scaled(s, accel=1 / G),
    "accel SI": lambda s: _scaled(s, accel=G),
    "sums": _sums,
    "rates": _rates,
    "counts": _counts,
    "gravity": lambda s: _scaled(s, accel=-1.0),
    "gyro reversed": lambda s: _scaled(s, gyro=-1.0),
    "gyro swapped": lambda s: _axes(s, gyro=_SWAP),
    "gyro one sign": lambda s: _axes(s, gyro=np.diag([1.0, 1, -1])),
    "accel swapped": lambda s: _axes(s, accel=_SWAP),
    "both swapped": lambda s: _axes(s, _SWAP, _SWAP),
    "both turned": lambda s: _axes(s, _CYCLE, _CYCLE),
    "hemisphere": lambda s: _site(s, latitude="-48.8462 deg"),
    "latitude": lambda s: _site(s, latitude="38.8462 deg"),
    "wrong g": lambda s: _site(s, gravity="9.7 m/s^2"),
    "gyro dead": lambda s: _dead(s, GYRO),
    "accel dead": lambda s: _dead(s, ACCEL),
    "two lost": _lost,
    "gyro lost": lambda s: _from_the_middle(s, GYRO[0]),
    "accel lost": lambda s: _from_the_middle(s, ACCEL[2]),
    "gyro repeated": lambda s: _repeated(s, GYRO),
    "accel repeated": lambda s: _repeated(s, ACCEL),
    "spike": _spike,
    "empty row": _empty,
    "gyro clipped": lambda s: _clipped(s, GYRO, 0.7),
    "accel clipped": lambda s: _clipped(s, ACCEL, 0.7),
    "s as ms": lambda s: s.with_columns(time=s.columns["time"] / 1e3),
    "gyro arcsec": lambda s: _scaled(s, gyro=3600.0),
    "clock fast": lambda s: s.with_columns(time=s.columns["time"] * 1.01),
    "clock slightly fast": lambda s: s.with_columns(time=s.columns["time"] * 1.001),
    "gyro stuck": _stuck,
    "site exchanged": _site_exchanged,
    "accel one sign": lambda s: _axes(s, accel=np.diag([1.0, 1, -1])),
    "accel one unit": lambda s: _axes(s, accel=np.diag([1.0, 1 / G, 1])),
    "gyro one unit": lambda s: _axes(s, gyro=np.diag([1.0, 1 / DEG, 1])),
    "triads exchanged": _triads_exchanged,
    "place exchanged": _exchanged,
    "master late": _master_late,
    "prior contradicted": _contradicted,
    "part reversed": lambda s: _part_reversed(s),
    "mag unit": lambda s: _mag(s, lambda m: 10.0 * m),
    "mag elsewhere": lambda s: _mag(s, lambda m: 2.5 * m),
    "mag one sign": lambda s: _mag(s, lambda m: m * [1.0, 1.0, -1.0]),
    "mag turned": lambda s: _mag(s, lambda m: m[:, [1, 2, 0]]),
    "mag repeated": lambda s: _mag(s, lambda m: m[np.arange(len(m)) // 4 * 4]),
    "mag clipped": lambda s: _mag(s, lambda m: np.minimum(m, 0.7 * m.max())),
    "mag stuck": lambda s: _mag(s, lambda m: m * [1.0, 0.0, 1.0]),
    "iron moved": lambda s: _mag(s, lambda m: m + 2e-6 * (np.arange(len(m)) > len(m) / 2)[:, None]),
    "samples lost": _lost_rows,
    "pose conjugated": lambda s: _pose(s, lambda t, p, q: (t, p, q * [1.0, -1.0, -1.0, -1.0])),
    "pose order": lambda s: _pose(s, lambda t, p, q: (t, p, q[:, [1, 2, 3, 0]])),
    "pose y up": lambda s: _pose(s, lambda t, p, q: (t, *_upright(p, q))),
    "pose mm": lambda s: _pose(s, lambda t, p, q: (t, 1e3 * p, q)),
    "pose mirrored": lambda s: _pose(s, lambda t, p, q: (t, p * [1.0, 1.0, -1.0], q)),
    "pose clock fast": lambda s: _pose(s, lambda t, p, q: (1.01 * t, p, q)),
    "pose clock 2400": lambda s: _pose(s, lambda t, p, q: (1.0024 * t, p, q)),
    "pose ms": lambda s: _pose(s, lambda t, p, q: (1e3 * t, p, q)),
    "pose apart": lambda s: _pose(s, lambda t, p, q: (t[:-10], p[:-10], q[10:])),
    "pose jumped": lambda s: _pose(s, lambda t, p, q: (t, p + 0.05 * (t > t.mean())[:, None], q)),
    "pose outliers": lambda s: _pose(
        s, lambda t, p, q: (t, p + 0.05 * (_random().uniform(size=p.shape) < 0.02), q)
    ),
    "pose lost": lambda s: _pose(s, _held),
    "pose 10 Hz": lambda s: _pose(s, lambda t, p, q: (t[::5], p[::5], q[::5])),
    "pose jitter": lambda s: _pose(
        s, lambda t, p, q: (t + _random().exponential(2e-3, len(t)), p, q)
    ),
    "antennas swapped": lambda s: _antennas(
        s, lambda p, q: (q, p), prior={"pose.base.y": {"mean": "80 cm", "sd": "1 cm"}}
    ),
    "antennas renamed": lambda s: _antennas(s, lambda p, q: (q, p)),
    "antennas apart": lambda s: _antennas(
        s, lambda p, q: (p, q), procedure={"base_length": "85 cm"}
    ),
    "antenna twice": lambda s: _antennas(s, lambda p, q: (p, p)),
    "antenna lost": lambda s: _antennas(s, lambda p, q: (p, _gone(q))),
    "antenna dead": lambda s: _antennas(s, lambda p, q: (p, np.nan * q)),
    "antenna float": lambda s: _antennas(s, lambda p, q: (_float(p, 1), _float(q, 2))),
    "antenna axes": lambda s: _antennas(s, lambda p, q: (p, q[:, [1, 0, 2]])),
    "antennas axes": lambda s: _antennas(s, lambda p, q: (p[:, [1, 0, 2]], q[:, [1, 0, 2]])),
    "antenna loose": lambda s: _antennas(s, lambda p, q: (p, p + 0.8 * np.eye(3)[1])),
    "angles deg": lambda s: _angles(s, factor=1 / DEG),
    "angles sense": lambda s: _angles(s, sense=-1.0),
}
"""What people do wrong: a session as it would be, None where there is nothing to do wrong."""

COLUMNS = (*_QUICK, "align", "navigate", "allan", "delay", "apply", "watch")
"""Procedures and commands."""
