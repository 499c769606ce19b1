"""What can go wrong when a better plan is searched for."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("optimise.procedure", "error",
     "A search for a plan of a procedure that has none",
     "The plan of {procedure} is no data: there is nothing to search.",
     "Plans can be searched for {able}."),
    ("optimise.weight_name", "error",
     "A weight for a coefficient that does not exist",
     "[optimise] weights '{name}', which is neither a coefficient nor a group of them here.{hint}",
     "Known are: {allowed}. A single coefficient of a group has its axis behind that."),
    ("optimise.weight", "error",
     "A weight that is no number from 0 on",
     "[optimise] gives '{name}' the weight {given}.",
     "Give 0 to leave it out, 1 for the usual, more where it matters more."),
    ("optimise.weightless", "error",
     "Weights that leave nothing to improve",
     "[optimise] gives every coefficient the weight 0.",
     "Leave at least one above 0."),
    ("optimise.unseen", "error",
     "Coefficients that no allowed plan can see",
     "No plan that is allowed shows {count} of the coefficients that count: {names}. Allowed are "
     "{limits}.",
     "Allow more; or, where others are left to improve, give these weight 0 in [optimise]: then "
     "the search goes on without them, and the result names them as unseen."),
    ("optimise.det", "error",
     "Weights in a search for the smallest ellipsoid",
     "[optimise] has criterion = \"det\" and unequal weights: the volume of an ellipsoid does not "
     "know how much each of its axes counts.",
     "Take criterion = \"sd\", or weights of 0 and 1 only."),
    ("optimise.time", "error",
     "A time too short for one rotation",
     "At {rate} deg/s, {total} s turn the cluster through {angle:.0f} deg; below 360 deg not even "
     "one axis has been all around.",
     "Give `total` at least {needed:.0f} s, or allow a higher rate."),
    ("optimise.segment", "error",
     "Segments too long for the time there is",
     "Segments of {shortest} s fit only {fitting} times into {total} s; a plan needs at least "
     "{least} of them.",
     "Give `shortest` at most {longest:.0f} s, or more time with `total`."),
    ("optimise.rate", "error",
     "A rate beyond what the rig allows, or none",
     "[optimise] asks for {given} deg/s; the rig allows {limit}.",
     "Give rates above 0 and up to `rate_limit` in [procedure]."),
    ("optimise.time_limit", "error",
     "A time limit below zero",
     "--time-limit is {given}; no time is below zero.",
     'Give the time that the search may take, such as "60 s", or leave it out.'),
    ("optimise.latitude", "error",
     "A latitude beyond the poles, where plans are to be compared",
     "[optimise] compares plans at a latitude of {given:.6g} deg.",
     "Give latitudes from -90 to 90 deg."),
    ("optimise.limits", "error",
     "Limits of the rig that no plan keeps",
     "None of {tried} random plans keeps within {limits}.",
     "Allow more tilt or more cable, shorter segments (`shortest`) or a lower rate, or a `start` "
     "from which the rig can turn further."),
    ("optimise.missing", "error",
     "A search folder without a result",
     "{folder} holds no finished search for a plan.",
     "Make one, or let it finish: `foucault optimise CAMPAIGN -o {folder}`."),
    ("optimise.hardly", "warning",
     "A plan found that hardly shows some of what counts",
     "{count} of the coefficients that count keep more than half of their prior under the plan "
     "found: {names}.",
     "Allow more (time, rate, axes, tilt), search longer, or give them weight 0 in [optimise]."),
    ("optimise.reference_limits", "warning",
     "A plan to beat that the rig cannot do",
     "{name}, the plan to beat, breaks limits of the rig: {broken}. The plan found keeps them all, "
     "at {ratio:.3f} times its sd.",
     "Take the plan found. To come nearer to the other or further below it: a longer search "
     "(--restarts, --evaluations), more time in [optimise], or wider limits where the rig has "
     "them."),
    ("optimise.no_time", "warning",
     "A search that found nothing shorter",
     "After {evaluations} plans the shortest that reaches what is wanted takes {time} s; the plan "
     "to beat reaches it in {reference} s.",
     "Search longer (--restarts, --evaluations), allow more in [optimise], or keep that plan."),
    ("optimise.no_gain", "warning",
     "A search that found nothing better",
     "After {evaluations} plans the best is {ratio:.3f} times the sd of the plan to beat.",
     "Search longer (--restarts, --evaluations), allow more in [optimise], or keep that plan."),
)
# fmt: on
