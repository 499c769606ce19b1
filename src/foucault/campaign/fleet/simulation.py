"""Simulate a fleet: the means of many instruments in one file, and the truth beside it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import procedures
from foucault.campaign.mistakes import parse_at
from foucault.campaign.reading import Campaign
from foucault.campaign.running import SESSION_CAMPAIGN, keep_recorded, with_own_log, with_seed
from foucault.campaign.writing import log_table
from foucault.errors import error
from foucault.files import atomic, unwritable
from foucault.models.imu import LAYOUT
from foucault.models.noise import grade
from foucault.procedures.on_table.session import TableSession, TableSettings, draw_rig, plan_of
from foucault.simulate.table.fleet import table_of_means, truth_of
from foucault.simulate.table.readings import Fleet, SimulatedReadings, simulate_readings
from foucault.tables import whole_samples

MEANS_FILE, TRUTH_FILE = "means.parquet", "truth.parquet"

LOG = f'''\
serial = "serial"                       # a row per instrument and position
file = "{MEANS_FILE}"'''


def simulate(campaign: Campaign, instruments: int, seed: int | None = None) -> SimulatedReadings:
    """Simulate what many instruments of a class say in one session after the other.

    The table is the same for all; each instrument is mounted anew.

    `instruments`: number of them [1]; `seed`: seed, None takes that of the campaign [1].
    """
    session = campaign.session
    if not (isinstance(session, TableSession) and isinstance(campaign.settings, TableSettings)):
        known = [n for n in procedures.PROCEDURES
                 if issubclass(procedures.load(n).Session, TableSession)]  # fmt: skip
        raise error("fleet.simulate", procedure=campaign.procedure, allowed=", ".join(known))
    seed = campaign.simulate.seed if seed is None else seed
    draws = [int(s) for s in np.random.SeedSequence(seed).generate_state(4)]
    typical = grade(campaign.simulate.grade, "simulate.grade")
    plan = plan_of(campaign.settings, session)
    whole_samples(instruments * len(plan))  # before memory is taken
    fleet = Fleet.draw(campaign.simulate.grade, instruments, draws[0])
    fleet = _with_given(fleet, campaign)
    rig = draw_rig(session, draws[1])
    rng = np.random.default_rng(draws[2])
    rig = type(rig)(
        common=rig.common,
        position_sd=rig.position_sd,
        rate_error=rig.rate_error,
        rate_jitter=rig.rate_jitter,
        mounting=session.mounting_sd * rng.standard_normal((instruments, 3)),
        lever_arm=session.lever_arm_sd * rng.standard_normal((instruments, 3)),
        heading=rig.heading,
    )
    return simulate_readings(
        plan, models=fleet, noise=campaign.noise or typical.noise,
        site=campaign.site, rig=rig, interval=1.0 / session.rate, seed=draws[3],
    )  # fmt: skip


def _with_given(fleet: Fleet, campaign: Campaign) -> Fleet:
    """Set the coefficients that the campaign gives, the same for all instruments."""
    given = {}
    for name, text in campaign.simulate.errors.items():
        kind = LAYOUT.coefficients[LAYOUT.index(name)].kind
        given[name] = parse_at(f'simulate.errors."{name}"', text, kind)
    values = fleet.values(LAYOUT.names)
    for name, value in given.items():
        values[:, LAYOUT.index(name)] = value
    return Fleet.from_values(LAYOUT.names, values) if given else fleet


def save(
    campaign: Campaign, made: SimulatedReadings, folder: str | Path, seed: int | None = None
) -> Path:
    """Write a simulated fleet as a test bench would, with the truth beside it.

    `seed` or None: seed that was used, where it is not that of the campaign [1]. Returns the
    campaign file written; `foucault fleet` takes it as it is.
    """
    folder = Path(folder)
    keep_recorded(folder, TRUTH_FILE, (MEANS_FILE, SESSION_CAMPAIGN))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise unwritable(folder, problem) from None
    _write(folder / MEANS_FILE, table_of_means(made))
    _write(folder / TRUTH_FILE, truth_of(made))
    own = log_table(campaign.procedure, averaged=True)
    head, _, rest = own.partition('file = "log.csv"')
    text = with_own_log(campaign.text, head + LOG + rest)
    if seed is not None:
        text = with_seed(text, seed)
    with atomic(folder / SESSION_CAMPAIGN) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return folder / SESSION_CAMPAIGN


def _write(path: Path, columns: dict[str, npt.NDArray[Any]]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(pa.table(columns), buffer)
    with atomic(path) as temporary:
        temporary.write_bytes(buffer.getvalue())
