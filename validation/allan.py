"""Allan variance: other programs, recovery of known noise, real logs; writes a page of the docs.

Deviations beside allantools (bench extra); 200 draws of each noise, coverage of the intervals
against binomial limits; real logs under $FOUCAULT_DATA (default ../shared/data).
"""

from __future__ import annotations

import allantools
import numpy as np
from common import DATA, must
from hand_rotated_logs import XSENS as XSENS_LOG
from scipy.stats import binom

from foucault.campaign import parse, read_log
from foucault.diagnose import allan
from foucault.diagnose import allan as allan_log
from make_noise import draw

XSENS = (
    XSENS_LOG.replace("{folder}", "{data}/xsens_hand_rotated")
    .replace("{procedure}", "hand_rotated")
    .replace("{settings}", "")
)

FALSE_ALARM = 0.01
SAMPLES = 32768
CASES = {
    "white": (0, 1, 0, 0, 0),
    "quantisation, white": (1, 0.01, 0, 0, 0),
    "white, flicker": (0, 1, 0.02, 0, 0),
    "flicker": (0, 0, 1, 0, 0),
    "white, random walk": (0, 1, 0, 1e-4, 0),
    "random walk": (0, 0, 0, 1, 0),
    "white, ramp": (0, 1, 0, 0, 1e-8),
    "all five": (1, 1, 0.02, 1e-5, 1e-8),
}
PEERS = {"overlapping": "oadev", "modified": "mdev", "hadamard": "ohdev"}

LN100 = """
[site]
latitude = "51.08 deg"
[log]
file = "{data}/ln100_static/x_LN100_up.ins"
format = "binary"
record = {{ type = "float64", columns = 7 }}
time = {{ column = 0, unit = "s" }}
gyro = {{ columns = [1, 2, 3], unit = "deg/s" }}
accel = {{ columns = [4, 5, 6], unit = "m/s^2" }}
[procedure]
name = "hand_rotated"
"""


def peers() -> tuple[list[str], bool]:
    """Compare deviations with allantools on common averaging times."""
    y = 1e-5 * draw(100_000, (1, 1, 1, 1e-3, 1e-9), np.random.default_rng(1)) + 0.3
    lines = []
    good = True
    for kind in allan.KINDS:
        tau, ours = allan.deviations(y, 0.01, kind=kind)
        peer = getattr(allantools, PEERS[kind])
        theirs = peer(y, rate=100.0, data_type="freq", taus=tau)[1]
        off = float(np.abs(ours[: len(theirs)] / theirs - 1).max())
        good &= off < 1e-10
        lines.append(
            f"| {kind} (`{PEERS[kind]}`) | {len(theirs)} | {off:.1e} | {must(off < 1e-10)} |"
        )
    return lines, good


def recovery(draws: int) -> tuple[list[str], bool]:
    """Count how often the interval holds the truth."""
    there = sum(np.count_nonzero(p) for p in CASES.values())
    edge = FALSE_ALARM / (5 * len(CASES) + there)
    low, high = (int(v) for v in binom.ppf([edge, 1 - edge], draws, 0.95))
    lines = [
        f"{draws} draws of {SAMPLES} samples each. The 95 % interval, or the limit where a draw "
        f"does not show the noise, must hold the truth in {low} draws or more, and in {high} at "
        "most where all draws show it (binomial, 1 % for the whole table together). Limits may "
        "hold more often: where the truth is zero every limit does, and only a noise seen by "
        "mistake counts against.",
        "",
        "| noise drawn | | quantisation | white | flicker | random walk | ramp |",
        "|---|---|---|---|---|---|---|",
    ]
    good = True
    for i, (name, p) in enumerate(CASES.items()):
        rng = np.random.default_rng([3, i])
        channels = [allan.measure(draw(SAMPLES, p, rng), 1.0) for _ in range(draws)]
        seen, held, ratio = [], [], []
        for j, truth in enumerate(np.sqrt(p)):
            noises = [channel.noises[j] for channel in channels]
            inside = sum(noise.low <= truth <= noise.high for noise in noises)
            always = all(noise.seen for noise in noises)
            right = low <= inside and (inside <= high or not always)
            good &= right
            seen.append(f"{sum(noise.seen for noise in noises)}")
            held.append(f"{inside}{'' if right else ' **outside**'}")
            mean = np.mean([noise.value**2 for noise in noises]) / truth**2 if truth else 0.0
            ratio.append(f"{mean:.3f}" if truth else "")
        lines += [
            f"| {name} | seen | {' | '.join(seen)} |",
            f"| | truth in interval | {' | '.join(held)} |",
            f"| | mean square over truth | {' | '.join(ratio)} |",
        ]
    return lines, good


def real() -> list[str]:
    """Show the noises of real instruments."""
    lines = []
    for title, text, rest, words in (
        (
            "LN-100 (ring laser), 300 s at rest",
            LN100, None,
            "The curve falls as 1/tau, with bumps: angle and velocity errors that stay bounded, as "
            "quantisation and vibration make them. It is read as quantisation, the bumps are "
            "reported, and within 300 s nothing else rises above it.",
        ),
        (
            "Xsens MTi (MEMS), first 50 s of the hand-rotated log",
            XSENS, (0.0, 50.0),
            "White noise, with a departure of some percent at short averaging times, where the "
            "variances are known best; 50 s are too short for anything slower.",
        ),
    ):  # fmt: skip
        log = read_log(parse(text.format(data=DATA), "log.toml"))
        measured = allan_log.measure_log(log, rest=rest)
        heading = ["| axis | noise | value | sd | 95 % interval |", "|---|---|---|---|---|"]
        lines += ["", f"### {title}", "", words, "", *heading]
        for name, channel in measured.channels.items():
            triad = name.split(".")[0]
            for i, noise in enumerate(channel.noises):
                cells = allan_log.described(noise, triad, channel.longest)
                lines.append(f"| {name} | {allan.WORDS[triad][i]} | {' | '.join(cells)} |")
        lines += ["", *(f"* {finding.message}" for finding in measured.findings)]
    return lines


def main(draws: int = 200) -> tuple[bool, dict[str, object]]:
    same, first = peers()
    found, second = recovery(draws)
    there = (DATA / "ln100_static").is_dir() and (DATA / "xsens_hand_rotated").is_dir()
    return first and second, {
        "version": allantools.__version__,
        "same": same,
        "found": found,
        "real": ["", "## Real logs", *real()] if there else [],
    }
