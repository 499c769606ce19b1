"""What the checks say: the sentences of every test, in one table.

A check is a number and its limits; its words are here, where it is inside them, below and above.
``{value}``, ``{low}`` and ``{high}`` are the number and its limits, everything else is given with
it. A sentence that begins with ``...`` goes on from the one inside the limits: with a blank after
it, else in place of its full stop.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from foucault.result import Check, Level


class Words(NamedTuple):
    """The sentences of a check: inside its limits, below and above them; one does for both sides.

    Without either the first is said in any case.
    """

    fine: str
    below: str = ""
    above: str = ""


WORDS = {
    "converged": Words("{advice}"),
    "not seen": Words("{advice} Not seen: {weakest}."),
    "scale factors": Words(
        "The largest {sensor} scale factor error is {value:.2g} %.",
        above="A {sensor} scale factor error of {value:.0f} % is a wrong unit or count scale, not "
        "an instrument: check [log.{triad}].",
    ),
    "impossible bias": Words(
        "A gyro bias of {value:.3g} deg/s is a wrong unit or count scale (arcsec/s read as deg/s: "
        "3600 times), or the instrument turned: check [log.gyro]."
    ),
    "prior": Words(
        "{name} is {value:.1f} standard deviations from what was known before.",
        above="...: {cause}.",
    ),
    "priors together": Words(
        "The {count} coefficients that were known before, taken together, are {value:.1f} standard "
        "deviations from that, {high:.1f} allowed: {cause}."
    ),
    "drift": Words(
        "The residuals do not follow time: the clearest drift, of {name}, is {size}.",
        above="The residuals follow time as if {name} had drifted by {size} from the first to the "
        "last observation: its value is that of the middle of the session, and what it changed by "
        "is in no uncertainty. Let the instrument warm up, take it in shorter sessions, or "
        "calibrate over temperature.",
    ),
    "terms left out": Words(
        "The residuals do not follow {what} that are not estimated: {terms}.",
        above="The residuals follow {what} that are not estimated: {terms}. What they do to the "
        "other coefficients is in no uncertainty. {cure}",
    ),
    "off alike": Words(
        "The mean of {group} is {ppm:+.4g} ppm, {off:.1f} standard deviations from what was known "
        "before.",
        above="...: {cause} puts all of them off alike.",
    ),
    "Earth reversed at rest": Words(
        "The rates at rest point along up by {rate:+.2f} +- {sd:.2f} deg/h; a reversed sign of the "
        "Earth's rate would make it {made:+.2f}.",
        above="... It is probably that: {cause}.",
    ),
    "Earth reversed in g-sensitivity": Words(
        "The g-sensitivity is {mean:+.1f} +- {sd:.1f} deg/h per g, mean of all axes; a reversed "
        "sign of the Earth's rate would make it {made:+.1f} about each.",
        below="... It may well be that: {cause}. Set g_sensitivity = false to see.",
    ),
    "plan": Words(
        "The uncertainty of {name} is {value:.1f} times what noise and plan allow.",
        above="...: `foucault preflight` promises a better result of this plan. Some readings do "
        "not belong to the others, and their scatter is shared by all.",
    ),
    "Earth's rate": Words(
        "By the times of the log the Earth turns {rate} +- {sd} times its rate.",
        above="...: {causes}.",
    ),
    "noise at rest": Words("The readings at rest scatter no more than [noise] says."),
    "noise seen at rest": Words(
        "At rest {triad} {axis} scatters {ratio:.2f} times as much as [noise.{triad}] says: "
        "{cause}. The noise that is seen was used.",
        above="..., so that the uncertainties are those of this session.",
    ),
    "consistency": Words(
        "The mean {name} is {value:.3f} times its degrees of freedom, inside {low:.3f} to "
        "{high:.3f}: the covariance is right.",
        "The mean {name} is {value:.3f} times its degrees of freedom, below {low:.3f}: the "
        "uncertainties are too large.",
        "The mean {name} is {value:.3f} times its degrees of freedom, above {high:.3f}: the "
        "uncertainties are too small.",
    ),
    # -- studies -------------------------------------------------------------------------------
    "no trial": Words("No trial produced an estimate."),
    "every coefficient": Words(
        "The {what} of every coefficient fits {against}.",
        above="The {what} of {failed} does not fit {against}.",
    ),
    "coverage": Words(
        "{value:.1f} % of the truths lie inside the {percent} % intervals (expected {low:.1f} to "
        "{high:.1f} %)."
    ),
    "failures": Words("Of {total} trials: {parts}."),
    # -- systematic calibration ----------------------------------------------------------------
    "innovations": Words(
        "What is seen at rest scatters {ratio:.3f} times as much as allowed for.",
        above="...: the instrument stands less still than velocity_sd and position_sd say, is "
        "noisier, or has errors that are not estimated, so that the uncertainties are too small.",
    ),
    "innovations, still": Words(
        "What is seen at rest scatters {ratio:.3f} times as much as allowed for; it stands stiller "
        "than velocity_sd and position_sd say, which does no harm."
    ),
    "scatter of rests": Words(
        "No rest scatters more than allowed for.",
        above="{out} of {count} rests scatter more than allowed for; the farthest is rest {rest}, "
        "{begin:.0f} to {end:.0f} s: it moved, or the turn before it shows an error that is not "
        "estimated.",
    ),
    "velocities": Words(
        "Navigated {run} with the calibration, the velocity is at most {value:.1f} times what is "
        "promised from zero.",
        above="...: {axis} in rest {rest}, at {time:.0f} s.",
    ),
    "seen by the session": Words(
        "The session tells something of every coefficient.",
        above="The session tells hardly anything of {names}: what is said of them is what was "
        "known before.{sums}",
    ),
    "seen as sums": Words("{sums}"),
    "deflection not seen": Words(
        "No deflection is seen{bounds}.",
        below="The gyros bend, but as no model says that this session sees whole; the likeliest is "
        "{rival}, of which it sees {rank} of {count} combinations.",
    ),
    "deflection": Words(
        "The gyros bend: {used}, {count} coefficients; the probability of so much by chance is "
        "{chance}. Of the others {rival}{seen} comes next, {times} {less} likely.",
        above="The gyros bend: {used}, {count} coefficients; the probability of so much by chance "
        "is {chance}. But {rival} is {times} likelier.",
    ),
    "deflection not significant": Words(
        "The deflection does not differ from zero at 1 %{bounds}.",
        above="... But {rival} is {times} likelier.",
    ),
    "errors left out": Words("No error that is left out shows.", below="{message}"),
    "recordings": Words(
        "The biases of the recordings differ no more than was declared.",
        above="The biases of the recordings differ more than was declared: {each}. Declare what "
        "the instrument has; or something else than switching on has changed, such as its "
        "temperature.",
    ),
    # -- platform tumble -----------------------------------------------------------------------
    "tumble readings": Words(
        "What is left of the readings scatters {ratio:.3f} times as much as the noise explains.",
        above="...: noise is smaller or larger than [noise] says, or the model lacks something, so "
        "that the uncertainties are wrong.",
    ),
    "tumble axis": Words(
        "The {axis} accelerometer scatters {ratio:.3f} times as much as the noise explains."
    ),
    "stretches": Words(
        "Of {parts} stretches of the log {value:.0f} scatter otherwise than the noise explains; "
        "the farthest, {begin:.0f} to {end:.0f} s, {ratio:.2f} times as much."
    ),
    "neighbours": Words(
        "Neighbouring residuals are unrelated.",
        above="Neighbouring residuals are related ({correlation:+.3f}): an error of readings or "
        "motion that the model lacks, or noise that is not white.",
    ),
    "slow errors": Words(
        "Over longer parts of the log residuals add up to {ratio:.2f} times what noise explains.",
        above="...: the gyros are noisier or quieter than [noise.gyro] says, or readings drift, so "
        "that the uncertainties are wrong.",
    ),
    "start": Words(
        "The cluster began {away:.2f} deg from `start`.",
        above="..., farther than start_sd and azimuth_sd allow.",
    ),
    "seen by the motion": Words(
        "The motion shows {shown} of {count} coefficients.",
        above="...; the others are known hardly better than before.",
    ),
    "delay": Words(
        "Readings and command belong to the same times.",
        above="The readings are {ms:.3g} ms older than their time, {sds:.0f} times its "
        "uncertainty: with `delay_sd` it is estimated, without it bends the result.",
    ),
    "delay estimated": Words("The delay is estimated."),
    "delay not seen": Words("The motion does not show a delay."),
    # -- temperature ---------------------------------------------------------------------------
    "temperatures": Words(
        "{name}: {count} temperatures for {terms} terms, with {value:.0f} to spare.",
        below="{name}: {count} temperatures for {terms} terms: a function fits them whatever they "
        "are. Calibrate at one temperature more.",
    ),
    "terms": Words(
        "No family needs more terms than it has; nearest is {name} ({has}) against a {more}, "
        "probability {value:.2g}.",
        below="{name} is no {has}: a {more} fits better by F = {F:.3g}, which chance does with "
        "probability {value:.1g}. Leave out --order, or ask for a higher one.",
    ),
    "scatter of sessions": Words(
        "Residuals agree with the covariances and the declared scatter: chi-square {value:.4g} "
        "with {dof} degrees of freedom.",
        "Residuals are smaller than covariances and declared scatter say: chi-square {value:.4g} "
        "with {dof} degrees of freedom. The sessions' uncertainties, or --scatter, are too large.",
        "Residuals are larger than covariances and declared scatter say: chi-square {value:.4g} "
        "with {dof} degrees of freedom. Leave out --scatter to have it found, or look for a "
        "session unlike the others.",
    ),
    "temperature left out": Words(
        "Each of {count} temperatures is predicted by the others; the worst is {at}, {name}, "
        "probability {value:.2g}.",
        below="The sessions at {at} ({who}) are not what the others predict: {name}, probability "
        "{value:.1g}. Look at this session, or calibrate at temperatures between.",
    ),
    "heating and cooling": Words(
        "Heating and cooling agree; nearest is {name}, probability {value:.2g}.",
        below="{name} differs between heating and cooling, F = {F:.3g}, probability {value:.1g}: "
        "the instrument has hysteresis, or its sensor of temperature lags. Wait longer at each "
        "temperature, or declare the difference with --scatter.",
    ),
    "constant over a ramp": Words(
        "Sessions at several temperatures tell what a ramp does not.",
        above="{names}: known at one temperature, taken as constant over all. Calibrate at a "
        "second temperature to know.",
    ),
    # -- navigation ----------------------------------------------------------------------------
    "heading at the start": Words("The heading at the start is known to {sd} deg (sd)."),
    "last epoch": Words(
        "{what} at the last epoch: off by {off} {unit}, predicted {sd} {unit} (sd): as predicted.",
        above="{what} at the last epoch: off by {off} {unit}, predicted {sd} {unit} (sd): more "
        "than noise and calibration explain.",
    ),
    "not judged": Words("Not judged: {why}."),
    "last epoch not judged": Words(
        "Not judged: {why}. {what} at the last epoch: off by {off} {unit}, what is known makes "
        "{sd} {unit} (sd)."
    ),
    # -- results merged ------------------------------------------------------------------------
    "nothing in common": Words(
        "{label}: no coefficient in common with the others, so nothing to compare."
    ),
    "agreement": Words(
        "{label}: chi-square of the differences {square} of {dof} degrees of freedom, at most "
        "{high:.1f} if nothing has changed.{farthest}",
        above="... The instrument changed, or an uncertainty is too small.",
    ),
    "own verdict": Words("{label}: its own verdict is {level}.{reason}"),
    # -- finding north -------------------------------------------------------------------------
    "sees the Earth": Words(
        "The Earth's horizontal rate is {ratio} times the uncertainty of the rates.",
        "...: the gyro is too noisy by a factor of {factor:.2g}; dwell {times:.2g} times as long, "
        "or take a better gyro.",
    ),
    "rate and latitude": Words(
        "The Earth's rate as measured fits the latitude to {sd:.2f} sd.",
        above="...: latitude, scale factor or sign of the accelerometer may be wrong.",
    ),
    "one heading": Words(
        "No other heading fits.",
        "Heading {heading:.3f} deg, at latitude {latitude:.2f} deg, fits as well.",
    ),
    "tilt": Words(
        "The tilt is {value:.2f} deg.", above="...: heading is hardly defined there."
    ),
    "accuracy": Words(
        "The heading has a standard deviation of {value:.4g} deg.",
        above="...; {high:.4g} deg was wanted.",
    ),
    "worst": Words(
        "The {what} that fits worst is {size:.1f} standard deviations from the others.",
        above="...: more than chance gives.",
    ),
    "level": Words(
        "The {what} stands {ratio:.2f} times level_sd off level.",
        above="...: it is less level than was said.",
    ),
    "calibration used": Words("The calibration that was used is {level}."),
    # -- every mixed model ---------------------------------------------------------------------
    "redundancy": Words(
        "{n} {readings} leave {value:.3g} numbers more than the unknowns need.",
        "...: at least {low:g} are needed to notice a bad one. {cure}",
    ),
    "noise": Words(
        "The residuals of {what} are {ratio:.2f} times what the noise says ({dof} redundant).",
        "The residuals of {what} are only {ratio:.2f} times what the noise says ({dof} redundant): "
        "{overstated} overstated and so are the uncertainties.",
        "The residuals of {what} are {ratio:.1f} times what the noise explains ({dof} redundant)"
        "{then}",
    ),
    "noise untested": Words("Nothing tests the noise of {what}: no reading is redundant."),
    "noise unknown": Words(
        "The noise of {what} is unknown and was taken from its residuals ({dof} redundant).",
        "The noise of {what} is unknown and the residuals do not tell it ({dof} redundant, "
        "{low:g} needed): the uncertainties mean little. Declare [noise], or {more}.",
    ),
    "repeatability": Words(
        "{what} scatters by {size} from one reading to the next beyond the noise.",
        above="..., more than {limit}: {cause}.",
    ),
    "evenness": Words(
        "Both halves of the session fit alike ({what}).",
        above="The {what} of the {worse} half of the session fit {times:.1f} times worse than the "
        "others: it was disturbed, warming up, or lost samples, and no single uncertainty "
        "describes all of it.",
    ),
    "held out": Words(
        "{what} that the fit did not see are predicted to {ratio:.2f} times their predicted "
        "uncertainty{size}.",
        above="...: the model lacks something, or some of them do not belong to the others.",
    ),
    "prediction": Words(
        "A rest that the fit did not see is known {value:.1f} times worse than one that was "
        "measured.",
        above="..., more than {high:g} times: without any few of the rests the others hardly "
        "determine the accelerometers. Add rests in other orientations.",
    ),
    "rests": Words(
        "{value} rests were used.",
        "Only {value} rests: at least {low} are needed to notice a bad one.",
    ),
    "half-space": Words(
        "The orientations lie on all sides.",
        above="All rests lie in one half-space: bias and scale are hard to tell apart. Add rests "
        "with {missing}.",
    ),
    "condition": Words(
        "The orientations determine the accelerometer coefficients well (condition {value:.0f}).",
        above="The orientations determine the accelerometer coefficients poorly (condition "
        "{value:.0f}, even coverage has 2). Add rests with {missing}.",
    ),
    "shaken rests": Words(
        "{shaken} of {n} rests are more than {limit:g} times as noisy as the quietest part of the "
        "log.",
        above="...: the instrument was held or shaken there, and the noise measured in the rests, "
        "with every uncertainty that follows from it, is that of the hand. Put it down for each "
        "rest; for this log set threshold = {quieter:g} in [procedure], so that only what is "
        "quieter than that counts as rest.",
    ),
    "vertical Earth rate": Words(
        "The vertical Earth rate is seen as {seen:+.1f} +- {sd:.1f} deg/h, expected {want:+.1f}.",
        "... Its sign is reversed: {cause}.",
        "..., more than twice that: g-sensitivity, or a bias that drifts.",
    ),
    # -- on faces ------------------------------------------------------------------------------
    "single faces": Words(
        "{n} rests on {faces} faces leave {free} of {equations} equations of specific force over. "
        "They test whether opposite faces have the same bias; scale factors and misalignments are "
        "not tested: an error there would not be seen."
    ),
    "repeated faces": Words(
        "{n} rests on {faces} faces leave {free} of {equations} equations of specific force over. "
        "They test whether opposite faces have the same bias, and whether rests on the same face "
        "agree."
    ),
    "turns untested": Words(
        "{n} turns determine nine gyro coefficients and nothing is left over: a turn that was not "
        "as declared would not be seen. Turn about each axis twice to test it."
    ),
    "whole turns": Words(
        "The turns, as the data show: {turns}. They are as whole as the scale factors of the gyros "
        "allow to say; they count as exact to {sd} arcmin (sd), {where}.",
        above="The turn about {axis} is {value:+.1f} % off: a scale factor error of the gyro, or "
        "{off:.0f} deg that were turned too much or too little. {alone}Turn against a stop, and "
        "twice about each axis, or declare `angle_sd`.",
    ),
    "placement exact": Words("The placements count as exact{where}."),
    "placement": Words(
        "The placements are off by {size} arcmin (sd), {where}; they are part of the "
        "uncertainties.",
        above="... That is too much: use a block with square faces on a level support.",
    ),
    "placement beyond": Words(
        "The placements are off by {size} arcmin (sd), more than the {high:.2g} arcmin that "
        "`placement_sd` says, or a rest is wrong; it is part of the uncertainties. Leave "
        "`placement_sd` out to have it estimated."
    ),
    # -- rate table ----------------------------------------------------------------------------
    "scale factor terms": Words(
        "The scale factors change by {value:.3g} ppm over the rates measured.",
        above="...: that is saturation or a wrong rate of the table, not a gyro.",
    ),
    "bias drift": Words(
        "The gyro bias moved by {moved}, {value:.2g} times the noise of a step; it is part of the "
        "uncertainties.",
        above="The gyro bias moved by {moved}, {value:.2g} times the noise of a step: let the "
        "gyros warm up, or hold the steps shorter. It is part of the uncertainties.",
    ),
}  # fmt: skip
"""Key of a check -> its sentences."""


def check(
    key: str,
    name: str,
    value: float,
    low: float | None = None,
    high: float | None = None,
    given: Mapping[str, Any] = MappingProxyType({}),
    *,
    fails: Level = Level.DOUBTFUL,
    excused: bool = False,
    passed: bool = True,
) -> Check:
    """Return a check with its sentence.

    `key`: of `WORDS`; `value`, `low`, `high`: the number and its limits [unit of the sentence];
    `given`: what else the sentence says; `excused`: outside its limits, but accounted
    for in the uncertainties: it is said, and does not fail; `passed`: False where no number says
    that it fails.
    """
    below = low is not None and value < low
    above = high is not None and value > high
    words, text = WORDS[key], ""
    if below or above:
        text = (words.below or words.above) if below else (words.above or words.below)
    if text.startswith("..."):
        text = words.fine.removesuffix("" if text[3] == " " else ".") + text[3:]
    sentence = (text or words.fine).format(value=value, low=low, high=high, **given)
    if excused:
        low, high = (None if below else low), (None if above else high)
    return Check(name, value, low, high, passed, sentence, fails)
