"""Transfer alignment: what a straight run, an S-turn and accelerations show."""

from __future__ import annotations

from transfer_setting import DEG, SITE, unit_of

from foucault.plans.manoeuvres import Accelerate, Start, Straight, STurn
from foucault.plans.transfer import TransferProfile, transfer_profile
from foucault.procedures.record import Beforehand
from foucault.procedures.transfer_alignment.session import Session, foreseen
from foucault.procedures.transfer_alignment.settings import NOISE, Settings

START = Start(32 * DEG, 118 * DEG, 1000.0, heading=40 * DEG, speed=45.0)
PLANS = {
    "straight": (Straight(240.0),),
    "S-turn": (Straight(60.0), STurn(40 * DEG, 40.0), Straight(140.0)),
    "speed": (Straight(20.0), Accelerate(55.0, 20.0), Accelerate(45.0, 20.0), Straight(40.0),
              Straight(140.0)),
    "flight": transfer_profile("flight").calibration,
    "uav": transfer_profile("uav").calibration,
    "ship": transfer_profile("ship").calibration,
}  # fmt: skip
PROTOTYPE = {
    "installation.x": (1.5, 0.12, 0.07), "accel.bias.y": (440.0, 40.0, 20.0),
    "gyro.scale.x": (476.0, 137.0, 40.0),
}  # fmt: skip


def main() -> tuple[bool, dict[str, object]]:
    vectors = {}
    for name, calibration in PLANS.items():
        start = START if name not in ("uav", "ship") else transfer_profile(name).start
        plan = TransferProfile(name, start, calibration)
        perfect = Settings(left_out=False)
        session = Session(with_outage=False)
        vectors[name] = foreseen(plan, Beforehand(perfect, session, SITE, NOISE)).vector
    names = next(iter(vectors.values())).names
    shown = ["|---|---|--:|" + "--:|" * len(PLANS) + "---|"]  # fmt: skip
    for i, name in enumerate(names):
        size, unit = unit_of(name)
        cells = [f"{v.sd[i] / size:.3g}" for v in vectors.values()]
        prior = vectors["straight"].prior_sd[i] / size
        other = " / ".join(f"{x:g}" for x in PROTOTYPE.get(name, ()))
        other = "0.24 to 0.31 in all" if name.startswith("gyro.bias") else other
        shown.append(f"| {name} | {unit} | {prior:.3g} | {' | '.join(cells)} | {other} |")
    straight, flight = vectors["straight"], vectors["flight"]
    hidden = straight.sd > 0.3 * straight.prior_sd
    return (flight.sd[hidden] < 0.1 * straight.sd[hidden]).all(), {
        "shown": shown,
        "plans_join": " | ".join(PLANS),
    }
