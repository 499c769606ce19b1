"""A session that is recorded and guided at once: bytes into rows, rows into what to do next."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from foucault import campaign as campaigns
from foucault.arrays import FloatArray
from foucault.campaign import Campaign
from foucault.capture import recording
from foucault.capture.frame import Frame
from foucault.capture.guide import Guide
from foucault.capture.recording import Recording, campaign_of
from foucault.capture.source import Source, arrivals
from foucault.capture.trouble import Trouble, troubles
from foucault.capture.ways import Asked, guide_of
from foucault.files import write_text
from foucault.logs.description import LogDescription
from foucault.logs.follow import RowFollower
from foucault.tables import Log

LISTEN = 2.0
"""Rows that have no time of their own are heard for so long before they are dated [s]."""

PIECE = 0.25
"""Length of what the guide looks at together [s]."""

TOGETHER = 4096
"""Bytes that are taken before what is shown is looked at again [bytes]."""


@dataclass
class Live:
    """A source that is recorded, and the guide that is fed from it."""

    recorder: Recording
    asked: Asked
    guide: Guide | None = None
    silence: float = 0.0  # since something came [s]
    _held: list[FloatArray] = field(default_factory=list)  # rows (n, k) [units of the frame]
    _rows: RowFollower | None = None

    def troubles(self) -> list[Trouble]:
        """Return what is wrong between the instrument and here."""
        return troubles(self.recorder, self.silence)

    def take(self, data: bytes, now: float) -> bool:
        """Take bytes that were heard at `now` [s]; tell whether a rest has ended with them."""
        self._held += [self.recorder.take(data, now)]
        if sum(map(len, self._held)) < 3:
            return False
        if self._rows is None and not self._begin():
            return False
        assert self._rows is not None
        assert self.guide is not None
        part = self._rows.take(np.concatenate(self._held))
        self._held, ended = [], False
        if part is None:
            return False
        part = _fresh(self.guide, part)
        size = max(2, round(PIECE / part.interval)) if len(part) > 1 else 1
        for k in range(0, len(part), size):  # what comes late is looked at as if it came in time
            ended |= self.guide.add(part[k : k + size])
            if self.guide.stopped:
                break
        return ended

    def _begin(self) -> bool:
        frame, rows, rate = self.recorder.frame, np.concatenate(self._held), None
        if frame.field_of("time") is None:
            if rows[-1][-1] - rows[0][-1] < LISTEN:
                return False
            rate = float((len(rows) - 1) / (rows[-1][-1] - rows[0][-1]))
        warm = recording.warm_in(frame, rows)
        asked = self.asked.campaign
        text = campaign_of(frame, "session", None, rate, own_text(asked), warm)
        told = campaigns.parse(text, self.recorder.folder / recording.CAMPAIGN)
        self._rows = RowFollower(told.imu_log, len(rows[0]))
        assert self._rows.used is not None
        campaign = replace(told, noise=asked.noise, sizes=asked.sizes)
        campaign = asked if own_text(asked) is None else campaign
        self.guide = guide_of(replace(self.asked, campaign=campaign), self._rows.used)
        return True


def own_text(campaign: Campaign) -> str | None:
    """Return the text that says how a log of samples is calibrated; None: its stops are."""
    return campaign.text if isinstance(campaign.log, LogDescription) else None


def _fresh(guide: Guide, part: Log) -> Log:
    """Return what of a part is later than all before: a clock that was set back says nothing."""
    if not len(guide.found):
        return part
    last = guide.found.log.time[-1]
    return part if part.time[0] > last else part[int(np.searchsorted(part.time, last, "right")) :]


def guided(
    source: Source,
    frame: Frame,
    text: str,
    folder: Path,
    asked: Asked,
    *,
    tell: Callable[[Live, bool], None] = lambda _live, _ended: None,
    silent: float | None = None,
) -> tuple[Live, Campaign]:
    """Guide a session until it is enough, its source ends, or somebody interrupts it.

    `text`: the description of the frames as it was written; `tell`: called several times a second,
    and told whether a rest has ended; `silent` or None: end where nothing comes for so long [s].
    Returns what was guided, and the campaign of what was recorded.
    """
    live = Live(Recording(folder, frame), asked)
    write_text(folder / recording.FRAME, text)
    own: dict[str, Any] = {"text": own_text(asked.campaign)}
    write_text(folder / recording.CAMPAIGN, campaign_of(frame, folder.name, **own))
    begun = heard = time.monotonic()
    try:
        with closing(arrivals(source)) as coming:
            for data, now in coming:
                heard = now if data else heard
                live.silence = now - heard
                live.recorder.heard.reopened = getattr(source, "lost", 0)
                for k in range(0, max(len(data), 1), TOGETHER):
                    ended = live.take(data[k : k + TOGETHER], now - begun)
                    if ended and live.guide is not None:
                        live.guide.way.leave(folder)
                    tell(live, ended)
                if live.guide is not None and live.guide.stopped:
                    break
                if silent is not None and live.silence >= silent:
                    break
    except KeyboardInterrupt:
        pass
    finally:
        source.close()
        live.recorder.heard.reopened = getattr(source, "lost", 0)
        live.recorder.close(**own)
    left = None if live.guide is None else live.guide.way.leave(folder)
    return live, campaigns.load(left or folder / recording.CAMPAIGN)
