"""Positions on a table and poses for spins that a search finds, beside the known sets."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor

import numpy as np

from foucault.models.earth import Site
from foucault.models.noise import grade
from foucault.models.turntable import up_k
from foucault.plans.efficiency import efficiency
from foucault.plans.optimise import compare, descend
from foucault.plans.sequence import NAMES, best_poses, poses, quality
from foucault.plans.table import Wanted
from foucault.procedures import norm_observation, turntable
from foucault.procedures.record import Beforehand

SITE = Site(9.81, np.radians(45.0))
RESTARTS, EVALUATIONS = 4, 1500
SETS = (
    "12 edges", "icosahedron 12", "14 faces and corners", "18 faces and edges",
    "dodecahedron 20", "24 on great circles", "26 faces, edges and corners",
)  # fmt: skip
TILTING = {"middle_range": ("-35 deg", "95 deg")}
CABLE = {"cable_limit": "5 rev", "both_senses": True}
TABLES = (
    ("norm_observation", "icosahedron 12", {"accel_quadratic": True}, {}),
    ("norm_observation", "icosahedron 12", {}, {"integrity": True}),
    ("norm_observation", "dodecahedron 20", {}, {"weights": {"gyro": 0.0}}),
    ("norm_observation", "dodecahedron 20", TILTING, {}),
    ("norm_observation", "dodecahedron 20", {"angle_step": "45 deg"}, {}),
    ("norm_observation", "dodecahedron 20", {"angle_step": "15 deg"}, {}),
    ("norm_observation", "dodecahedron 20", TILTING | CABLE, {}),
    ("turntable", "dodecahedron 20", {"plumb_sd": "5 arcsec", "position_sd": "10 arcsec"}, {}),
)


def search(case: tuple) -> tuple:
    """Search as `foucault optimise` does: a round from random plans, the best once more."""
    name, plan, settings, wanted = case
    module = {"norm_observation": norm_observation, "turntable": turntable}[name]
    space = module.PROCEDURE.space(Beforehand(
        module.Settings(plan=plan, **settings), wanted=Wanted(**wanted),
        session=module.Session(rest_time=60.0, turns=4), site=SITE,
        noise=grade("tactical").noise, prior={},
    ))  # fmt: skip
    found = [descend(space, np.random.default_rng(k), EVALUATIONS) for k in range(RESTARTS)]
    best = min(found, key=lambda d: d.cost)
    again = descend(space, np.random.default_rng(99), EVALUATIONS, best.plan, 0.01)
    best = min(best, again, key=lambda d: d.cost)
    comparison = compare(space, best.plan)
    judged = [efficiency(up_k(np.array(p))) for p in (space.reference, best.plan)]
    return (
        case, space.reference_name, [e.d_efficiency for e in judged],
        comparison.geometric_mean, comparison.worst, [e.named for e in judged],
        [space.duration(p) for p in (space.reference, best.plan)],
        judged[1].log10_det,
    )  # fmt: skip


def main() -> tuple[bool, dict[str, object]]:
    """Search."""
    known = [("norm_observation", s, {}, {"criterion": c}) for s in SETS for c in ("det", "sd")]
    with ProcessPoolExecutor(2) as pool:
        rows = list(pool.map(search, [*known, *TABLES]))
    yes = {True: "yes", False: "no"}
    shown = []
    for case, name, d, mean, worst, _, time, _ in rows[: len(known)]:
        shown.append(
            f"| {name} | {case[3]['criterion']} | {d[0]:.4f} | {d[1]:.4f} | {mean.max():.4f} "
            f"| {worst.max():.3f} | {time[0]:.0f} | {time[1]:.0f} |"
        )
    twelve = next(r for r in rows if r[1] == "icosahedron 12")
    shown_2 = []
    for case, name, _, mean, worst, named, time, _ in rows[len(known) :]:
        said = ", ".join(f"{k} = {v}" for k, v in (case[2] | case[3]).items())
        shown_2.append(
            f"| {case[0]}: {said} | {name} | {mean.max():.4f} | {worst.max():.3f} "
            f"| {yes[named[0]]}, then {yes[named[1]]} | {time[0]:.0f} | {time[1]:.0f} |"
        )
    shown_3 = []
    sets = [(n, poses(n)) for n in NAMES]
    sets += [(f"optimised {n}", best_poses(n, starts=20)) for n in (6, 7, 8, 9)]
    for name, angles in sets:
        q, n = quality(angles), len(angles)
        shown_3.append(
            f"| {name} | {n} | {q.condition:.3f} | {q.spread:.4f} | {q.spread * n**0.5:.4f} |"
        )
    return True, {
        "restarts": RESTARTS + 1,
        "evaluations": EVALUATIONS,
        "shown": shown,
        "log10_det": twelve[-1],
        "shown_2": shown_2,
        "shown_3": shown_3,
    }
