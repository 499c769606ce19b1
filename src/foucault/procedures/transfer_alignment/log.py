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

LOG_TABLE = Path(__file__).with_name("log.toml").read_text(encoding="utf-8")
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
