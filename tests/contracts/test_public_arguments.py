"""Whatever a public function is given, it answers in numbers or in words: no traceback from inside.

Logs that are damaged in every way that arrays can be, and arguments of another type, size or
spelling: each is refused by one error that says what was given and what is allowed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import foucault
from foucault import ImuModel, ImuNoise, Log, Site, State
from foucault.models.noise import TriadNoise
from foucault.plans.manoeuvres import Climb, Rest, Start
from foucault.procedures.navigation.start import Settings
from foucault.simulate.motion import simulate_motion
from make_navigation import NOISE, SITE, START
from make_result import make_result
from refusals import refuses

GOOD = simulate_motion([Rest(60.0)], START, rate=50.0, noise=NOISE).log
N = len(GOOD)
assert GOOD.gyro is not None and GOOD.accel is not None
G, A, T = GOOD.gyro, GOOD.accel, GOOD.time


def put(x: np.ndarray, at: Any, value: float) -> np.ndarray:
    out = x.copy()
    out[at] = value
    return out


SHAPES = {
    "short gyro": {"gyro": G[:-5]}, "short time": {"time": T[:-5]}, "two axes": {"gyro": G[:, :2]},
    "four axes": {"accel": np.hstack([A, A[:, :1]])}, "flat": {"gyro": G[:, 0]},
    "transposed": {"gyro": G.T, "accel": A.T}, "column": {"time": T[:, None]},
    "one time": {"time": 3.0}, "no time": {"time": None}, "temperature": {"temperature": T[:4]},
    "words": {"gyro": np.full((N, 3), "a")}, "complex": {"gyro": G.astype(complex)},
    "dates": {"time": (1e9 * T).astype("datetime64[ns]")}, "ragged": {"gyro": [[1.0], [1.0, 2.0]]},
    "nothing": {"gyro": [[None] * 3] * (N - 1) + [["a"] * 3]}, "mag": {"mag": G[:, :2]},
}  # fmt: skip


@pytest.mark.parametrize("kind", SHAPES)
def test_a_log_is_of_numbers_with_a_row_for_each_time(kind: str) -> None:
    with refuses("argument.array", "of the log", "it must be numbers of shape"):
        replace(GOOD, **SHAPES[kind])


def test_a_log_says_what_it_holds() -> None:
    with refuses("argument.word", "Did you mean 'rate'?"):
        replace(GOOD, sampled="rates")  # type: ignore[arg-type]


def test_lists_other_floats_and_masks_are_arrays() -> None:
    masked = np.ma.array(G, mask=np.zeros((N, 3), bool))
    masked[7] = np.ma.masked
    log = Log(T.tolist(), G.astype(np.float32), masked)  # type: ignore[arg-type]
    assert log.gyro is not None and log.accel is not None
    np.testing.assert_array_equal(log.time, T)
    assert log.gyro.dtype == log.accel.dtype == float and type(log.accel) is np.ndarray
    np.testing.assert_array_equal(np.isnan(log.accel).any(axis=1), np.arange(N) == 7)
    assert replace(log).time is log.time  # nothing is copied that need not be


DAMAGED: dict[str, tuple[str, Any]] = {
    "nan": ("log.missing_value", {"gyro": put(G, 50, np.nan)}),
    "infinite": ("log.infinite", {"accel": put(A, (70, 1), np.inf)}),
    "huge": ("log.infinite", {"accel": put(A, (70, 1), 1e200)}),
    "no time": ("log.missing_value", {"time": put(T, 50, np.nan)}),
    "endless": ("log.infinite", {"time": put(T, -1, np.inf)}),
    "repeated": ("log.time_repeated", {"time": put(T, 50, T[49])}),
    "one time": ("log.time_repeated", {"time": 0 * T}),
    "backward": ("log.time_backward", {"time": put(T, 50, T[40])}),
    "reversed": ("log.time_backward", {"time": T[::-1].copy()}),
    "no axis": ("strapdown.no_axis", {"gyro": put(G, (slice(None), 2), np.nan)}),
    "no gyro": ("strapdown.no_triad", {"gyro": None}),
    "no accel": ("strapdown.no_triad", {"accel": np.full((N, 3), np.nan)}),
    "means": ("strapdown.averaged", {"averaged": np.ones(N)}),
    "empty": ("strapdown.few", slice(0)),
    "one row": ("strapdown.few", slice(1)),
    "an array": ("argument.kind", G),
    "a name": ("argument.kind", "log.csv"),
    "none": ("argument.kind", None),
}

USES: dict[str, Callable[[Any], Any]] = {
    "align_log": lambda log: foucault.align_log(log, site=SITE),
    "navigate_log": lambda log: foucault.navigate_log(log, site=SITE),
    "increments_of": foucault.increments_of,
}


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("kind", DAMAGED)
def test_a_log_that_cannot_be_navigated_is_refused(kind: str, use: str) -> None:
    code, change = DAMAGED[kind]
    log = (
        GOOD[change] if isinstance(change, slice)
        else replace(GOOD, **change) if isinstance(change, dict) else change
    )  # fmt: skip
    with refuses(code):
        USES[use](log)


@pytest.mark.parametrize("change", [{"gyro": put(G, -100, np.nan)}, {"time": put(T, -1, T[-5])}])
def test_rows_that_are_not_used_are_not_looked_at(change: dict[str, Any]) -> None:
    log = replace(GOOD, **change)
    foucault.align_log(log, site=SITE, end=50.0, methods=["two_vector"])
    foucault.navigate_log(log, site=SITE, settings=Settings(heading=0.1, align=25.0, end=50.0))


@pytest.mark.parametrize("rows", [2, 3, 6])
@pytest.mark.parametrize("use", ["align_log", "navigate_log"])
def test_a_moment_is_no_rest(use: str, rows: int) -> None:
    with pytest.raises(foucault.FoucaultError):
        USES[use](GOOD[:rows])


def align(**how: Any) -> Any:
    return foucault.align_log(GOOD, **({"site": SITE} | how))


def navigate(**how: Any) -> Any:
    return foucault.navigate_log(GOOD, **({"site": SITE, "settings": Settings(heading=0.1)} | how))


def simulate(**how: Any) -> Any:
    return simulate_motion(**({"plan": [Rest(1.0)], "start": START} | how))


WHITE = TriadNoise(white=1e-3)
ARGUMENTS: dict[str, tuple[str, Callable[[], Any]]] = {
    "no site": ("argument.kind", lambda: align(site=None)),
    "a part": ("argument.kind", lambda: align(noise="mems")),
    "a folder": ("argument.kind", lambda: align(calibration="run")),
    "rests in a row": ("argument.array", lambda: align(rests=[0.0, 20.0])),
    "rests of three": ("argument.array", lambda: align(rests=[(0.0, 1.0, 2.0)])),
    "a word for gaps": ("argument.word", lambda: align(gaps="brige")),
    "a word for a method": ("alignment.method", lambda: align(methods="kalmann")),
    "text for a bias": ("argument.kind", lambda: align(accel_bias_sd="1 mg")),
    "a mapping": ("argument.kind", lambda: navigate(settings={"heading": 0.1})),
    "a longitude": ("argument.kind", lambda: navigate(longitude="11 deg")),
    "a file": ("argument.kind", lambda: navigate(reference="gnss.csv")),
    "a grade": ("argument.kind", lambda: navigate(noise=foucault.grade("mems"))),
    "another folder": ("argument.kind", lambda: navigate(calibration="run")),
    "a rate": ("argument.kind", lambda: simulate(rate="100 Hz")),
    "an endless rate": ("manoeuvre.value", lambda: simulate(rate=np.inf)),
    "no gravity": ("manoeuvre.value", lambda: simulate(gravity_offset=np.nan)),
    "one segment": ("argument.kind", lambda: simulate(plan=Rest(1.0))),
    "a word for a plan": ("argument.kind", lambda: simulate(plan="rest")),
    "a state": ("argument.kind", lambda: simulate(start=State.at_rest(np.eye(3), 0.8))),
    "a grade again": ("argument.kind", lambda: simulate(noise=foucault.grade("mems"))),
    "a word for a model": ("argument.kind", lambda: simulate(model="mems")),
    "a time": ("manoeuvre.value", lambda: Rest("300 s")),  # type: ignore[arg-type]
    "a start": ("manoeuvre.value", lambda: Start(0.8, "3 deg")),  # type: ignore[arg-type]
    "degrees": ("site.latitude", lambda: Site.at(48.8)),
    "no latitude": ("site.latitude", lambda: Site.at(np.nan)),
    "text": ("argument.kind", lambda: Site.at("48.8 deg")),  # type: ignore[arg-type]
    "no weight": ("site.gravity", lambda: Site(0.0, 0.8)),
    "less than no noise": ("noise.size", lambda: TriadNoise(white=-1e-3)),
    "no number": ("noise.size", lambda: TriadNoise(white=np.nan)),
    "half": ("argument.kind", lambda: ImuNoise(WHITE, 1e-3)),  # type: ignore[arg-type]
    "two biases": ("argument.array", lambda: ImuModel(gyro_bias=np.zeros(2))),
    "a wrong kind": ("argument.word", lambda: foucault.parse_unit("3 deg", "angel")),
    "another": ("argument.word", lambda: foucault.convert_unit(3.0, "angles", "deg")),
    "no grade": ("campaign.value", lambda: foucault.grade(3)),  # type: ignore[arg-type]
    "a log": ("argument.kind", lambda: foucault.calibrate(GOOD)),  # type: ignore[arg-type]
    "no campaign": ("argument.kind", lambda: foucault.load_campaign(3)),  # type: ignore[arg-type]
    "no folder": ("argument.kind", lambda: foucault.load_result(None)),  # type: ignore[arg-type]
    "a name": ("argument.kind", lambda: foucault.read_log("log.csv")),  # type: ignore[arg-type]
    "no log": ("argument.kind", lambda: foucault.write_log(G, "log.csv")),  # type: ignore[arg-type]
    "no result": ("argument.kind", lambda: foucault.save_result(None, "run")),  # type: ignore[arg-type]
    "an array": ("argument.kind", lambda: make_result().apply(G)),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("what", ARGUMENTS)
def test_an_argument_that_cannot_be_is_refused(what: str) -> None:
    code, call = ARGUMENTS[what]
    with refuses(code):
        call()


def test_an_optional_number_is_a_number_too() -> None:
    with refuses("manoeuvre.value"):
        Climb(20.0, height=np.nan)


def test_one_method_may_be_a_word() -> None:
    assert [a.method for a in align(methods="two_vector").found] == ["two_vector"]
