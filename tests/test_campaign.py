"""Campaign files: what they give in SI, and one clear error for every mistake."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from foucault import campaign, procedures
from foucault.errors import FoucaultError
from foucault.models import earth
from foucault.strict import description_of
from foucault.units import parse
from refusals import refuses

MINIMAL = """
[site]
latitude = "48.8462 deg"
height = "60 m"
[log]
file = "log.csv"
time = { column = "t", unit = "s" }
accel = { columns = ["ax", "ay", "az"], unit = "m/s^2" }
[procedure]
name = "hand_rotated"
"""


def _refused(text: str) -> FoucaultError:
    with pytest.raises(FoucaultError) as caught:
        campaign.parse(text)
    return caught.value


def test_minimal_campaign_in_si() -> None:
    read = campaign.parse(MINIMAL, Path("folder/campaign.toml"))
    assert read.site.latitude == pytest.approx(np.radians(48.8462), rel=1e-15)
    assert read.site.gravity == earth.gravity(np.radians(48.8462), 60.0)
    assert read.site.gravity_source == "normal gravity"
    assert read.procedure == "hand_rotated"
    assert read.settings == procedures.load("hand_rotated").Settings()
    assert read.noise is None
    assert read.prior == {}
    assert read.findings == ()
    assert read.folder == Path("folder")


def test_noise_prior_and_simulation_in_si() -> None:
    read = campaign.parse(
        MINIMAL
        + """
[noise]
grade = "mems"
[noise.gyro]
white = "0.1 deg/sqrt(h)"
random_walk = "2 deg/h/sqrt(h)"
[prior]
"gyro.bias" = { mean = "1 deg/h", sd = "10 deg/h" }
"accel.scale.x" = { mean = "0 ppm", sd = "500 ppm" }
[simulate]
seed = 4
grade = "tactical"
errors = { "gyro.bias.x" = "30 deg/h" }
"""
    )
    assert read.noise is not None
    assert read.noise.gyro.white == pytest.approx(parse("0.1 deg/sqrt(h)", "angle random walk"))
    assert read.noise.gyro.random_walk == pytest.approx(
        parse("2 deg/h/sqrt(h)", "rate random walk")
    )
    assert read.noise.accel.white == pytest.approx(120e-6 * 9.80665)
    rate = np.pi / 648000
    assert read.prior["gyro.bias"] == pytest.approx((rate, 10 * rate))
    assert read.prior["accel.scale.x"] == pytest.approx((0.0, 5e-4))
    assert (read.simulate.seed, read.simulate.grade) == (4, "tactical")
    assert read.simulate.errors == {"gyro.bias.x": "30 deg/h"}


def test_names_without_quotes_are_understood() -> None:
    quoted = '[prior]\n"gyro.bias" = { mean = "1 deg/h", sd = "10 deg/h" }\n'
    bare = '[prior]\ngyro.bias = { mean = "1 deg/h", sd = "10 deg/h" }\n'
    assert campaign.parse(MINIMAL + quoted).prior == campaign.parse(MINIMAL + bare).prior
    errors = '[simulate]\nerrors.gyro.bias.x = "30 deg/h"\n'
    assert campaign.parse(MINIMAL + errors).simulate.errors == {"gyro.bias.x": "30 deg/h"}


# (what to add or replace, code, message, part of the cure)
MISTAKES = [
    (
        MINIMAL.replace("latitude", "latitud"),
        "campaign.key",
        "site.latitud is not a key of a campaign file. Did you mean 'latitude'?",
        "Allowed in [site] are: date, gravity, gravity_sd, grid, height, latitude, longitude.",
    ),
    (
        MINIMAL.replace("[site]", "[sites]"),
        "campaign.key",
        "sites is not a key of a campaign file. Did you mean 'site'?",
        "Allowed in a campaign file are: instrument, log, master, noise",
    ),
    (
        MINIMAL + "windw = 3\n",
        "campaign.key",
        "procedure.windw is not a key of a campaign file.",
        "Allowed in [procedure] are: ",
    ),
    (
        MINIMAL + '[noise.gyro]\nwhit = "0.1 deg/sqrt(h)"\n',
        "campaign.key",
        "noise.gyro.whit is not a key of a campaign file. Did you mean 'white'?",
        "Allowed in [noise.gyro] are: bias_instability",
    ),
    (
        MINIMAL + '[prior]\n"gyro.bias" = { mean = "0 deg/h", sdd = "10 deg/h" }\n',
        "campaign.key",
        "prior.\"gyro.bias\".sdd is not a key of a campaign file. Did you mean 'sd'?",
        'Allowed in [prior."gyro.bias"] are: mean, sd.',
    ),
    (
        MINIMAL + "[simulate]\nsede = 3\n",
        "campaign.key",
        "simulate.sede is not a key of a campaign file. Did you mean 'seed'?",
        "Allowed in [simulate] are: ",
    ),
    (
        MINIMAL.replace('"60 m"', "60"),
        "unit.missing",
        "site.height: 60 has no unit; length wants a number and a unit.",
        'for example "250 m"',
    ),
    (
        MINIMAL.replace('"60 m"', '"60 deg"'),
        "unit.kind",
        "site.height: 'deg' does not measure length.",
        'for example "250 m"',
    ),
    (
        MINIMAL.replace('"60 m"', "60").replace('"48.8462 deg"', '"48.8462 degg"'),
        "unit.unknown",
        "site.latitude: Unit 'degg' is not known. Did you mean deg or degree?"
        " (1 more mistake beside it.)",
        "Known are m, s, min",
    ),
    (
        MINIMAL.replace("48.8462", "95"),
        "site.latitude",
        "site.latitude: 95 deg is outside -90 to 90 deg.",
        "perhaps latitude and longitude are exchanged",
    ),
    (
        MINIMAL.replace('height = "60 m"', 'gravity = "1 g"\nheight = "60 m"').replace(
            "1 g", "0.98 g"
        ),
        "site.gravity",
        "site.gravity: 9.61052 m/s^2 is outside 9.7 to 9.9 m/s^2.",
        "normal gravity is then used",
    ),
    (
        MINIMAL.replace('"60 m"', '"60 km"'),
        "site.height",
        "site.height: 60000 m is outside -500 m to 20 km.",
        "above the ellipsoid, in m or km",
    ),
    (
        MINIMAL.replace("height", 'longitude = "8541 deg"\nheight'),
        "site.longitude",
        "site.longitude: 8541 deg is outside -360 to 360 deg.",
        "from -180 to 180 deg or from 0 to 360 deg",
    ),
    (
        MINIMAL.replace("height", 'longitude = "1e15 deg"\nheight'),
        "unit.range",
        "site.longitude: ",
        "",
    ),
    (
        MINIMAL + "held_out = true\n",
        "campaign.value",
        "procedure.held_out: True is not allowed; it should be a number, not true or false.",
        "",
    ),
    (
        MINIMAL.replace('"60 m"', '"-6000 m"'),
        "site.height",
        "site.height: -6000 m is outside -500 m to 20 km.",
        "it sets local gravity",
    ),
    (
        MINIMAL.replace("48.8462 deg", "1 17.5 deg"),
        "unit.unknown",
        "site.latitude: Unit '17.5 deg' is not known. A quantity is one number and one unit.",
        "Known are m, s, min",
    ),
    (
        MINIMAL.replace("48.8462 deg", "48d50m46sE"),
        "unit.angle",
        "site.latitude: '48d50m46sE' is not an angle in degrees, minutes and seconds: E is no side "
        "of it.",
        '"48d50m46s"',
    ),
    (
        MINIMAL.replace('latitude = "48.8462 deg"', ""),
        "site.unknown",
        "site: neither gravity nor latitude is given, so the scale of the accelerometers has no "
        "reference.",
        'gravity = "9.80943 m/s^2"',
    ),
    (
        MINIMAL.replace('name = "hand_rotated"', 'name = "hand_rotatde"'),
        "campaign.procedure",
        "Procedure 'hand_rotatde' is not known. Did you mean 'hand_rotated'?",
        "Known procedures are: hand_rotated",
    ),
    (
        MINIMAL.replace('name = "hand_rotated"', ""),
        "campaign.required",
        "procedure.name is missing.",
        'Add it (name = "hand_rotated")',
    ),
    (
        MINIMAL.replace('[procedure]\nname = "hand_rotated"', ""),
        "campaign.required",
        "procedure is missing.",
        "Add it (a table [procedure])",
    ),
    (
        MINIMAL + '[prior]\n"gyro.bias" = { mean = "0 deg/h" }\n',
        "campaign.required",
        'prior."gyro.bias".sd is missing.',
        'Add it (sd = "10 deg/h")',
    ),
    (
        MINIMAL + '[prior]\n"gyro.bais" = { mean = "0 deg/h", sd = "1 deg/h" }\n',
        "coefficient.unknown",
        "Coefficient 'gyro.bais' is not part of this model.",
        "gyro.bias.x",
    ),
    (
        MINIMAL + '[prior]\n"gyro" = { mean = "0 deg/h", sd = "1 deg/h" }\n',
        "prior.kind",
        'prior."gyro" holds coefficients of several kinds: angular rate, scale factor error, '
        "misalignment, g-sensitivity, cubic, deflection.",
        '"gyro.bias" and "gyro.scale"',
    ),
    (
        MINIMAL + '[prior]\n"gyro.bias" = { mean = "0 deg/h", sd = "0 deg/h" }\n',
        "prior.sd",
        "prior.\"gyro.bias\": sd = '0 deg/h' is not positive, or too small to calculate with.",
        "leave the prior out",
    ),
    (
        MINIMAL + '[prior]\n"gyro.bias" = { mean = "0 deg/h", sd = "1e-300 deg/h" }\n',
        "prior.sure",
        "prior.\"gyro.bias\": sd = '1e-300 deg/h' is beyond every instrument.",
        "a thousandth of what the session shows",
    ),
    (
        MINIMAL + '[prior]\n"gyro.bias" = { mean = "0 ppm", sd = "1 deg/h" }\n',
        "unit.kind",
        "prior.\"gyro.bias\".mean: 'ppm' does not measure angular rate.",
        '"0.01 deg/h"',
    ),
    (
        MINIMAL + "[noise]\n",
        "noise.empty",
        "noise: neither a grade nor a part nor a noise of accel or gyro is given.",
        "mems, tactical, navigation",
    ),
    (
        MINIMAL + '[noise]\ngrade = "mem"\n',
        "campaign.value",
        "noise.grade: 'mem' is not allowed; it should be one of mems, tactical, navigation. "
        "Did you mean 'mems'?",
        "`foucault schema`",
    ),
    (
        MINIMAL + '[simulate]\nseed = "one"\n',
        "campaign.value",
        "simulate.seed: 'one' is not allowed; it should be a valid integer",
        "`foucault schema`",
    ),
    (
        MINIMAL.replace("[site]", '[instrument]\nname = ["a"]\n[site]'),
        "campaign.value",
        "instrument.name: ['a'] is not allowed; it should be a valid string.",
        "`foucault schema`",
    ),
    (
        'procedure = "x"\n[log]\nfile = "a.csv"\n',
        "campaign.value",
        "procedure: 'x' is not allowed; it should be a table, [procedure].",
        "`foucault schema`",
    ),
    (
        MINIMAL.replace("[site]", '[prior]\n"gyro.bias" = "1 deg/h"\n[site]'),
        "campaign.value",
        "prior.\"gyro.bias\": '1 deg/h' is not allowed; it should be a table, "
        '[prior."gyro.bias"], with keys of these: mean, sd.',
        "`foucault schema`",
    ),
    (
        MINIMAL + "[noise\n",
        "campaign.syntax",
        "'campaign.toml' is not valid TOML: ",
        "one `key = value` per line",
    ),
]


@pytest.mark.parametrize(("text", "code", "message", "cure"), MISTAKES, ids=lambda v: str(v)[:24])
def test_one_clear_error(text: str, code: str, message: str, cure: str) -> None:
    problem = _refused(text)
    assert problem.code == code
    assert problem.message.startswith(message), problem.message
    assert cure in problem.cure


def test_syntax_error_names_the_line() -> None:
    problem = _refused("[site]\nlatitude = 48.8 deg\n")
    assert "line 2" in problem.message


def test_misspelt_simulated_coefficient_is_refused_when_simulated() -> None:
    read = campaign.parse(MINIMAL + '[simulate]\nerrors = { "gyro.bais.x" = "1 deg/h" }\n')
    with pytest.raises(FoucaultError, match=r"Did you mean 'gyro\.bias\.x'\?"):
        campaign.simulate(read)


def test_gravity_far_from_normal_is_a_finding() -> None:
    near = MINIMAL.replace("height", 'gravity = "9.8095 m/s^2"\nheight')
    assert campaign.parse(near).findings == ()
    assert campaign.parse(near).site.gravity == 9.8095

    far = campaign.parse(near.replace("9.8095", "9.7805")).findings
    assert [f.code for f in far] == ["site.gravity_differs"]
    assert "9.78050 m/s^2 differs from normal gravity" in far[0].message
    assert "by 2955 ppm" in far[0].message


@pytest.mark.parametrize(
    ("words", "sd"),
    [
        ('gravity = "9.8095 m/s^2"', earth.NORMAL_GRAVITY_SD),
        ("", earth.NORMAL_GRAVITY_SD),
        ('gravity = "9.8095 m/s^2"\ngravity_sd = "1 mGal"', 1e-5),
        ('gravity = "9.8095 m/s^2"\ngravity_sd = "0 m/s^2"', 0.0),
    ],
)
def test_gravity_without_its_uncertainty_has_that_of_the_gravity_model(words, sd):
    read = campaign.parse(MINIMAL.replace("height", f"{words}\nheight", 1))
    assert read.site.gravity_sd == pytest.approx(sd)


def test_missing_file_suggests_a_near_name(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(MINIMAL)
    assert campaign.load(tmp_path / "campaign.toml").site.height == 60.0
    with refuses("campaign.missing") as caught:
        campaign.load(tmp_path / "campain.toml")
    assert caught.value.message.endswith("does not exist. Did you mean 'campaign.toml'?")
    (tmp_path / "binary.toml").write_bytes(b"\x00\x01")
    with pytest.raises(FoucaultError, match="is not valid TOML"):
        campaign.load(tmp_path / "binary.toml")
    with pytest.raises(FoucaultError, match=r"folder; in it is binary\.toml, campaign\.toml\."):
        campaign.load(tmp_path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_file_as_editors_save_it(encoding: str, tmp_path: Path) -> None:
    text = MINIMAL + '[instrument]\nname = "Müller"\n'
    (tmp_path / "campaign.toml").write_bytes(text.replace("\n", "\r\n").encode(encoding))
    read = campaign.load(tmp_path / "campaign.toml")
    assert read.instrument["name"] == "Müller" and read.text == text


def test_a_log_instead_of_a_campaign(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,ax\n0,1\n")
    with refuses("campaign.other_file") as caught:
        campaign.load(tmp_path / "log.csv")
    assert 'file = "log.csv"' in caught.value.cure


@pytest.mark.parametrize("file", ["campaign.toml", "log.csv"])
@pytest.mark.parametrize("text", ["", "\n  \n# nothing yet\n"])
def test_an_empty_file(file: str, text: str, tmp_path: Path) -> None:
    (tmp_path / file).write_text(text)
    with refuses("campaign.empty") as caught:
        campaign.load(tmp_path / file)
    assert f"{file}' has nothing in it" in caught.value.message


def test_what_only_reads_a_log_needs_no_procedure() -> None:
    text = MINIMAL.replace("[procedure]", "").replace('name = "hand_rotated"', "")
    assert campaign.parse(text, calibrates=False).site.height == 60.0
    assert _refused(text).message == "procedure is missing."


@pytest.mark.parametrize("name", procedures.PROCEDURES)
def test_template_loads_as_it_is(name: str) -> None:
    text = campaign.template(name)
    read = campaign.parse(text)
    assert read.procedure == name
    # Writing the defaults out changes nothing but the last bit of a unit's conversion.
    for told, default in (("settings", "Settings"), ("session", "Session")):
        fresh = getattr(procedures.load(name), default)().model_dump()
        for key, value in getattr(read, told).model_dump().items():
            same = pytest.approx(fresh[key], rel=1e-15) if isinstance(value, float) else fresh[key]
            assert value == same, key
    assert max(len(line) for line in text.splitlines()) <= 100


LONG = {"transfer_alignment", "systematic", "imu_pose", "two_imus", "continuous_spin",
        "magnetometer", "rate_table", "turntable", "multi_position"}  # fmt: skip
"""Procedures whose sessions are long as their templates have them."""


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.thorough] * (name in LONG))
    for name in procedures.PROCEDURES
])  # fmt: skip
def test_template_runs_as_it_is_on_its_simulated_log(name: str, tmp_path: Path) -> None:
    session = campaign.simulate(campaign.parse(campaign.template(name)))
    result = campaign.calibrate(campaign.save_session(session, tmp_path))
    assert result.procedure == name
    assert result.verdict.level == "pass", result.verdict.reasons
    # A tumble says what its noise leaves out, rests at right angles what they cannot tell apart;
    # nothing else has anything to say.
    expected = {"platform_tumble": ["tumble.white"], "systematic": ["systematic.stands_for"]}
    assert [f.code for f in result.findings] == expected.get(name, [])


@pytest.mark.parametrize("name", procedures.PROCEDURES)
def test_every_key_of_a_template_is_explained(name: str) -> None:
    module = procedures.load(name)
    for model in (module.Settings, module.Session):
        for key in model.model_fields:
            assert description_of(model, key), key


def test_template_with_every_comment_opened_loads() -> None:
    lines = campaign.template("hand_rotated").splitlines()
    opened = [
        line.removeprefix("# ")
        if line.startswith(
            ("# [", '# "', "# grade", "# white", "# gravity", "# errors", "# threshold =")
        )
        else line
        for line in lines
    ]
    read = campaign.parse("\n".join(opened))
    assert read.noise is not None
    assert set(read.prior) == {"gyro.bias", "accel.scale.x"}


def test_resolved_campaign_reads_back_to_the_same(tmp_path: Path) -> None:
    text = MINIMAL + (
        '[noise]\ngrade = "mems"\n[noise.gyro]\nwhite = "0.1 deg/sqrt(h)"\n'
        '[prior]\n"gyro.bias" = { mean = "1 deg/h", sd = "10 deg/h" }\n'
        '[simulate]\nseed = 4\nerrors = { "gyro.bias.x" = "30 deg/h" }\n'
    )
    first = campaign.parse(text, tmp_path / "a" / "campaign.toml")
    again = campaign.parse(campaign.resolved(first, tmp_path / "b" / "run"), tmp_path / "x.toml")
    for part in ("site", "settings", "session", "noise", "prior", "simulate", "instrument"):
        assert getattr(again, part) == getattr(first, part), part
    assert again.log.file == "../../a/log.csv"
    assert again.log.accel == first.log.accel
    once_more = campaign.resolved(again, tmp_path)
    assert tomllib.loads(once_more) == tomllib.loads(campaign.resolved(again, tmp_path))


def test_a_column_that_is_not_there_survives(tmp_path: Path) -> None:
    """A rate table logs its outer angle alone; the campaign in the run folder must read back."""
    one = 'table = { columns = ["outer", "", ""], unit = "deg" }'
    text = MINIMAL.replace("[procedure]", f"{one}\n[procedure]")
    assert one in text
    first = campaign.parse(text)
    again = campaign.parse(campaign.resolved(first, tmp_path))
    assert again.log.table == first.log.table
    assert first.log.table is not None and first.log.table.columns == ("outer", None, None)


def test_text_that_toml_must_escape_survives(tmp_path: Path) -> None:
    note = 'say "hi"\\ \t°C \u007f'
    text = MINIMAL + f"[instrument]\nnote = {json.dumps(note)}\n"
    again = campaign.parse(campaign.resolved(campaign.parse(text), tmp_path))
    assert again.instrument["note"] == note


@pytest.mark.thorough
def test_schema_accepts_the_template_and_refuses_mistakes() -> None:
    schema = campaign.schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    check = jsonschema.Draft202012Validator(schema)
    good = tomllib.loads(campaign.template("hand_rotated"))
    assert list(check.iter_errors(good)) == []
    for change in (
        {"sites": {}},
        {"site": {"latitude": 48.8}},
        {"procedure": {"name": "unknown"}},
        {"procedure": {"name": "hand_rotated", "windw": 1}},
        {"simulate": {"sede": 1}},
        {"noise": {"grade": "mem"}},
    ):
        assert list(check.iter_errors(good | change)), change


def test_saved_session_runs_from_its_own_folder(tmp_path: Path) -> None:
    read = campaign.parse(MINIMAL + "[simulate]\nseed = 2\n[prior]\n")
    session = campaign.simulate(read, seed=5)
    file = campaign.save_session(session, tmp_path)
    again = campaign.load(file)
    assert again.simulate.seed == 5
    assert again.site == read.site
    log = campaign.read_log(again)
    np.testing.assert_array_equal(log.gyro, session.simulation.log.gyro)
    np.testing.assert_array_equal(log.accel, session.simulation.log.accel)
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["seed"] == 5
    by_name = {row["name"]: row["value"] for row in truth["coefficients"]}
    assert by_name["gyro.bias.x"] == session.simulation.model.gyro_bias[0]
    assert len(truth["rests"]["first"]) == len(truth["rests"]["C_nb"])
    np.testing.assert_array_equal(
        campaign.simulate(again).simulation.log.gyro, session.simulation.log.gyro
    )


def test_injected_error_is_in_the_simulated_instrument() -> None:
    read = campaign.parse(MINIMAL + '[simulate]\nerrors = { "gyro.bias.x" = "30 deg/h" }\n')
    assert campaign.simulate(read).truth.value("gyro.bias.x") == pytest.approx(
        parse("30 deg/h", "angular rate")
    )


def test_the_example_values_of_the_template_beside_a_real_log_are_noticed(tmp_path: Path) -> None:
    session = campaign.simulate(campaign.parse(campaign.template("hand_rotated")))
    file = campaign.save_session(session, tmp_path)
    assert campaign.read_log(campaign.load(file)).findings == ()
    (tmp_path / "truth.json").unlink()  # now it could be anybody's log
    (found,) = campaign.read_log(campaign.load(file)).findings
    assert found.code == "campaign.template"
    assert found.message.endswith("only an example: [site] and the name in [instrument].")
    text = file.read_text()
    assert "# CHANGE THIS to your own place" in text
    assert '# gravity_sd = "0.0004 m/s^2"' in text

    def noticed(*changes: tuple[str, str]) -> list[str]:
        changed = text
        for old, new in changes:
            assert old in changed
            changed = changed.replace(old, new)
        file.write_text(changed)
        return [f.message for f in campaign.read_log(campaign.load(file)).findings]

    named = ('"example IMU"', '"IMU 7"')
    # A new name beside the old place is the dangerous one: g is silently wrong.
    assert noticed(named) == ["Still as in the template, which is only an example: [site]."]
    assert noticed(named, ("48.8462 deg", "48.8 deg")) == []
    assert noticed(named, ('"60 m"', '"65 m"')) == []
    assert noticed(named, ('# gravity = "9.81234', 'gravity = "9.80929')) == []
