"""The log of a slave beside what its master said, and how a campaign describes the two."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from foucault import logs
from foucault.errors import error
from foucault.files import sha256
from foucault.logs import master as masters
from foucault.logs.checks import on_a_shared_clock
from foucault.logs.master_description import MasterDescription
from foucault.models.master import MasterTable
from foucault.tables import Log

MASTER_FILE = "master.csv"
"""File of the messages of a simulated master."""

LOG_TABLE = """\
[log]
file = "log.csv"                        # the slave's IMU; relative to this file
# CSV or spaced text (.gz too), Parquet, .npy, .npz, .mat and binary records can be read.
# Columns by name, or by number from 0 in a file without a header; "-gy" flips a sign.
# Without a time column write rate = "100 Hz" instead of `time`.
time = { column = "time", unit = "s" }
gyro = { columns = ["gyro_x", "gyro_y", "gyro_z"], unit = "rad/s" }
accel = { columns = ["accel_x", "accel_y", "accel_z"], unit = "m/s^2" }
# x, y, z are right, forward and up of the slave's own case; at rest the axis that points up reads
# +1 g. Forward, right, down: columns = ["wy", "wx", "-wz"] and ["fy", "fx", "-fz"].
# Readings are taken as those of the moment that is stamped. An IMU that adds up from sample to
# sample says so, or half an interval gets into the delay:
#   gyro = { columns = [...], unit = "0.1 arcsec", kind = "increment" }
#   accel = { columns = [...], unit = "m/s", kind = "increment" }
# The same for means of rates, at 100 Hz: unit = "0.01 deg" and "0.01 m/s", kind = "increment".

[master]
file = "master.csv"                     # what the vehicle's INS said
# time: when each message arrived, by the clock of the slave's log. Where the log has the master's
# own stamp too: time = that stamp, and arrival = { column = "arrival", unit = "s" }.
time = { column = "time", unit = "s" }
velocity = { columns = ["ve", "vn", "vu"], unit = "m/s" }
#   North, east, down: velocity = { columns = ["vn", "ve", "vd"], unit = "m/s", frame = "NED" }
attitude = { columns = ["heading", "pitch", "roll"], unit = "deg" }
#   Heading clockwise from north, pitch nose up, roll right side down. One that counts from north
#   to west: attitude = { ..., sense = "counter-clockwise" }; "-roll" turns a sign.
# Without positions the run begins at [site]: give the height of the run there, for gravity.
# position = { columns = ["latitude", "longitude", "height"], unit = "deg" }
"""
"""[log] and [master] of the template."""

SIMULATED_TABLE = """\
[log]
file = "log.csv"                        # relative to this file; it says itself what it holds

[master]
file = "master.csv"                     # the titles of its columns say what they are
"""
"""The same of a simulated session."""


@dataclass(frozen=True)
class SlaveLog(Log):
    """The log of a slave, and what its master said.

    Attributes
    ----------
    time, gyro, accel, temperature, averaged, begins : ndarray
        Of the slave, as in `Log` [SI].
    sampled, findings, source, table, clock
        The same.
    master : MasterTable or None
        Messages of the master.
    """

    master: MasterTable | None = None

    @classmethod
    def of(cls, log: Log, master: MasterTable) -> SlaveLog:
        """Return the log of a slave beside what its master said.

        `log`: readings of the slave [SI]; `master`: messages of the master [SI].
        """
        told = (*on_a_shared_clock(log.findings), *master.findings)
        return cls(log.time, log.gyro, log.accel, log.sampled, log.temperature, told, log.source,
                   log.table, log.averaged, log.clock, log.begins, master)  # fmt: skip

    @property
    def messages(self) -> MasterTable:
        """What the master said; refused where there is no master."""
        if self.master is None:
            raise error("transfer.no_master")
        return self.master


def with_master(log: Log, description: MasterDescription, folder: str | Path) -> SlaveLog:
    """Read the table of the master beside the log of a slave.

    `log`: readings of the slave [SI]; `folder`: folder that a relative file name starts from.
    """
    assert description.file is not None
    table, file = masters.read(description, folder), Path(folder) / description.file
    source = log.source | {"master": {"file": description.file, "sha256": sha256(file)}}
    return replace(SlaveLog.of(log, table), source=source)


def write_log(log: SlaveLog, path: str | Path) -> None:
    """Write the log of a slave, and the table of its master beside it.

    `log`: what was simulated [SI]; `path`: file of the slave's log, `MASTER_FILE` gets into the
    same folder.
    """
    logs.write(log, path)
    masters.write(log.messages, Path(path).with_name(MASTER_FILE))


def log_table(log: Log | None = None) -> str:
    """Write the tables [log] and [master] of the template, or for a simulated `log` [SI]."""
    return LOG_TABLE if log is None else SIMULATED_TABLE
