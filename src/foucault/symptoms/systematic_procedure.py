"""What can go wrong in the procedure of systematic calibration, its sequence aside."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("systematic.published", "error",
     "Published steps without a deflection to estimate",
     "steps = \"published\" estimates the deflection in its second step, and deflection is "
     "\"none\".",
     'Take steps = "joint", or choose a model of deflection.'),
    ("systematic.first_part", "error",
     "A session that cannot be cut into the published steps",
     "steps = \"published\" estimates all but the deflection over the first sequence, and the "
     "deflection over those that follow; {what}.",
     'Name at least two sequences, such as sequence = ["19 positions", "spins, simple 6"], or '
     'take steps = "joint", which needs no parts.'),
    ("systematic.recordings_published", "error",
     "Published steps of several recordings",
     "steps = \"published\" carries the navigation of one log on to the second step, and the log "
     "is {count} recordings.",
     'Take steps = "joint", which estimates all recordings together.'),
    ("systematic.recordings_sequence", "error",
     "Not one sequence for each recording",
     "The log is {count} recordings, and there is {given}.",
     "Name one built-in sequence for each file, in order, such as sequence = [\"19 positions\", "
     '\"spins, simple 6\"]; or leave it empty, sequence = [], which takes the rests as the files '
     "have them."),
    ("systematic.recordings_planned", "note",
     "A plan of several recordings",
     "[log] has `more` files, and what is foreseen is one recording of the whole sequence: biases "
     "are then those of that switch-on.",
     "Of n recordings the biases are uncertain by the repeatability over sqrt(n) besides; all else "
     "differs little."),
    ("systematic.recordings", "note",
     "Biases of several recordings",
     "The log is {count} recordings. Biases are the means over switch-ons, known no better than "
     "the recordings repeat: by gyro_bias_repeatability and accel_bias_repeatability those of "
     "each are off by {declared}.",
     "Declare both as your instrument has them. What the biases were in each recording is in the "
     'result, under "recordings" in its diagnostics.'),
    ("systematic.no_sequence", "error",
     "A simulation without a sequence",
     "No sequence is declared, so that there is none to simulate.",
     'Name one, such as sequence = ["19 positions"], or list `actions`.'),
    ("systematic.all_move", "error",
     "Rests of which hardly one is still",
     "Of {rests} rests {given} are still; it takes two or more.",
     "Clamp the table, and look for what moves it; look at the log with `foucault inspect`."),
    ("systematic.first_rest", "error",
     "A first rest that is too short to align in",
     "The first rest lasts {time} s; the attitude at the start needs {least} s or more.",
     "Rest a minute or more before the first turn."),
    ("systematic.interval", "error",
     "Rests too short for the time between updates",
     "With interval = {interval} s rest {number}, of {rest} s, has less than two updates.",
     "Leave `interval` out (1 s), or rest longer."),
    ("systematic.start_heading", "warning",
     "Biases before the session that leave no heading to start from",
     "By what is known of the biases beforehand the heading at the start is uncertain by {sd} deg, "
     "and the equations are not linear over that.",
     "Subtract a rough gyro bias first and say so in [prior], or do this with gyros that find "
     "north."),
    ("systematic.recognised", "note",
     "A session that is one of the built-in sequences",
     "The turns of the log are those of the sequence '{name}'.",
     "Name it in `sequence`: turns and rests are then compared one by one."),
    ("systematic.unseen", "warning",
     "Coefficients that the sequence does not show",
     "The session tells hardly anything of {names}.",
     "Add {wanted}; or leave out what is not wanted."),
    ("systematic.only_sum", "warning",
     "Asymmetry and quadratic terms that the sequence does not tell apart",
     "{sentence}",
     "Add {wanted}; or leave out accel_quadratic, so that one number stands for both; or give what "
     'is known of one of them in [prior] "accel.quadratic".'),
    ("systematic.stands_for", "note",
     "One of asymmetry and quadratic term left out where they look alike",
     "In the rests of this session a quadratic term of the accelerometers {axes} and an asymmetry "
     "of their scale factor look much alike, and {left} is left out: what is said of {kept} is "
     "{meaning}, and its uncertainty is that of this sum.",
     "Nothing to do where {left} is zero, or up, down and level are all that is wanted. Else "
     "{cure}."),
    ("systematic.only_prior", "note",
     "Coefficients known better beforehand than the session tells",
     "What is said of {names} is what [prior] says; the session adds hardly anything.",
     "Nothing to do if it is sure; if not, give a larger sd in [prior]."),
    ("systematic.levers_forgotten", "error",
     "Lever arms estimated from turns that are forgotten",
     "lever_arms = true estimates lever arms from what turns do to the velocity, and "
     "decorrelate = true forgets at every rest what the turn did.",
     "Leave out decorrelate: where lever arms are estimated turns count in full."),
    ("systematic.curves", "warning",
     "Accelerometers that seem to have an asymmetry or quadratic terms, which are left out",
     "The readings are explained better with {left}, which is left out: the probability of so much "
     "by chance is {chance} (said below 0.5 %). Other coefficients have taken in what they can of "
     "it.",
     "Set {cure}. Checks that fail then too show another error, which looks like it."),
    ("systematic.bends", "warning",
     "Gyros that seem to bend, in a session calibrated without deflection",
     "The readings are explained better if the gyros bend under specific force, and deflection is "
     '"none": the probability of so much by chance is {chance} (said below 0.5 %). Other '
     "coefficients have taken in what they can of it.",
     "{cure}. Checks that fail then too show another error, which looks like it: one of the "
     "turns, of the table, or one that is not estimated, such as lever arms."),
    ("systematic.deflection_unseen", "error",
     "A model of deflection that the session cannot see",
     "The model of deflection '{model}' has {count} parameters, and this session tells {rank} "
     "combinations of them better than 3 arcsec/g. It cannot see: {blind}.",
     "Add {wanted}; or choose a model with fewer parameters (coupled6 is seen whole by the 19 "
     'positions and the six spins); or give what is known of them in [prior] "deflection".'),
    ("systematic.deflection_planned", "warning",
     "A planned session that does not see the whole model of deflection",
     "The model of deflection '{model}' has {count} parameters, and the planned session tells "
     "{rank} combinations of them better than 3 arcsec/g. A calibration will {then} what it cannot "
     "see: {blind}.",
     "Add {wanted}; or choose a model with fewer parameters; or give what is known of them in "
     '[prior] "deflection".'),
    ("systematic.accuracy", "error",
     "A wanted accuracy that is none",
     "The accuracy wanted of {name} is '{given}'; it has to be above zero, of a coefficient or of "
     "a group whose members have one unit.",
     'Give it with its unit, such as accuracy."gyro.bias" = "0.001 deg/h".'),
    ("systematic.accuracy_unknown", "error",
     "A wanted accuracy of something that is not estimated",
     "An accuracy is wanted of {name}, which the procedure as set does not estimate.",
     "Choose `deflection`, `lever_arms` and the like in [procedure] so that it is estimated, or "
     "one of {allowed}."),
    ("systematic.search_published", "error",
     "A search for a sequence of the published two steps",
     "A sequence that is found is one list of actions, and steps = \"published\" needs two named "
     "sequences.",
     'Take steps = "joint", which is the better filter too.'),
    ("systematic.deflection_prior", "warning",
     "Parameters of the deflection that are known only beforehand",
     "Of {count} parameters of the model of deflection '{model}' this session tells {rank} "
     "combinations. Of these only the prior says anything: {blind}.",
     "Add {wanted}; or choose a model with fewer parameters."),
    ("systematic.choice_unseen", "error",
     "A choice between models of deflection of which the session sees none whole",
     "deflection = \"choose\" needs a session that sees at least one model whole. Of each this one "
     "tells only so many combinations better than 3 arcsec/g: {ranks}.",
     'Add {wanted}; or take deflection = "none"; or give what is known of the deflection in '
     '[prior] "deflection".'),
    ("systematic.choice_close", "warning",
     "Models of deflection that the session does not tell apart",
     "More than one model of deflection explains the session. If none was likelier beforehand: "
     "{shares}.",
     "Add spins in six other poses: \"spins, simple 6\" and \"spins, icosahedral 6\" after the 19 "
     "positions tell them apart; or choose by how the gyros are made."),
    ("systematic.choice_rival", "warning",
     "Another model of deflection that fits better",
     "The readings are {times} likelier with the deflection model {rival} than with {used}: the "
     "deflection, and what goes with it, is wrong.",
     "{cure}."),
    ("systematic.choice_study", "error",
     "Many sessions compared while the model of deflection is chosen in each",
     "deflection = \"choose\" may find other coefficients in each session, and here the same ones "
     "of all are compared.",
     'Name a model, such as deflection = "coupled6".'),
)
# fmt: on
