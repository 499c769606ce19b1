"""A run calibrated once more from its log by the program as it is now.

A change of the program is then not taken for a change of the instrument: the new result lies beside
the old one, which it names, and from then on it is the one that counts.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from foucault import __version__, run_folder
from foucault import campaign as campaigns
from foucault.errors import error
from foucault.files import alone, sha256
from foucault.records.store import Records, Run
from foucault.run_folder import CAMPAIGN_FILE

Tell = Callable[[float, str], None]


def rerun(
    records: Records, run: Run, *, progress: Tell = lambda done, words: None,
    page: Callable[[Path], object] = lambda folder: None,
) -> Run:  # fmt: skip
    """Calibrate a run again into a folder beside its own and take that in.

    `page` writes the page of a folder. Raises ``records.edited``, ``records.no_campaign``,
    ``records.other_log``: what it was made from is not what it was.
    """
    records.checked(run)
    folder = records.folder_of(run)
    if not (folder / CAMPAIGN_FILE).is_file():
        raise error("records.no_campaign", folder=folder)
    campaign = campaigns.load(folder / CAMPAIGN_FILE)
    _refuse_other_logs(records, run, campaign)
    beside = folder.with_name(f"{folder.name}@{__version__}")
    with alone(beside):
        result = campaigns.calibrate(campaign, progress)
        run_folder.save(result, beside, campaigns.resolved(campaign, beside))
        page(beside)
    added, failed = records.add(
        [beside], date=run.holds if run.dated == "given" else "", instrument=run.instrument,
        references=records.used_by(run), again=run.sha256,
    )  # fmt: skip
    for _, problem in failed:
        raise problem
    return added[0] if added else records.run(str(beside))


def _refuse_other_logs(records: Records, run: Run, campaign: campaigns.Campaign) -> None:
    """Refuse a log that is gone or is not the one that the run was made from."""
    wanted = records.logs_of(run)
    names = [campaign.log.file, *campaign.log.more]
    there = {}
    for name in names:
        file = campaign.folder / name
        if not file.exists():
            raise error("records.other_log", file=file, what="is not there")
        there[sha256(file)] = file
    if wanted and not set(wanted) <= set(there):
        raise error("records.other_log", file=next(iter(there.values())),
                    what="is not the one that the run was made from")  # fmt: skip
