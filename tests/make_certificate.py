"""A laboratory with a run to certify: its files, its key, and certificates of it."""

from __future__ import annotations

import dataclasses
import datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from foucault import run_folder
from foucault.certificate import said
from foucault.certificate.content import Certificate, Replaced, Review, gathered
from foucault.result import TimeBase
from make_result import make_result

PASSWORD = "geheim"
DAY = datetime.date(2025, 3, 20)
REVIEW = Review(reviewer="A. Noether", reason="the bump is left out")

LABORATORY = """
[certificate]
languages = ["en", "de"]

[certificate.laboratory]
name = "Pendulum Calibration Laboratory"
street = "Rue de Vaugirard 28"
postcode = "75006"
city = "Paris"
country = "FR"
email = "lab@example.org"

[certificate.authorised_by]
name = "L. Foucault"
role = "Head of laboratory"

[certificate.method]
document = "CP-17, issue 4"

[certificate.references."gravimeter point 3"]
what = "gravity"
certificate = "G-2024-118"
issuer = "National metrology institute"
due = 2027-06-30

[certificate.references."frequency standard"]
what = "clock"
certificate = "F-2025-9"
issuer = "National metrology institute"
due = 2026-12-31

[certificate.references."thermometer 12"]
what = "thermometer"
certificate = "T-2025-41"
issuer = "Accredited laboratory 0042"
due = 2026-06-30
"""

JOB = """
[certificate]
number = "2025-0042"
received = 2025-03-10
performed = 2025-03-14
issued = 2025-03-20
used = ["gravimeter point 3", "frequency standard", "thermometer 12"]

[certificate.customer]
name = "Aero Works"
street = "Hangar 4"
postcode = "31000"
city = "Toulouse"
country = "FR"

[certificate.item]
description = "Inertial measurement unit"
manufacturer = "Xsens"
condition = "undamaged, sealed"

[certificate.method]
deviations = "none"

[certificate.conditions]
humidity = "(45 ± 5) %"

[certificate.unused]
table = "turned by hand: gravity alone gives the directions"

[certificate.adjustment]
done = "none"
"""


def make_run(folder: Path, **changes: Any) -> Path:
    """Save a run with a clock and a term that was left out."""
    result = make_result(**changes)
    left = {
        "what": np.array(["g-sensitivity of the gyros"]), "size": np.array(["10 deg/h/g"]),
        "basis": np.array(["grade told by noise (judgement)"]), "share": np.array([0.31]),
        "times": np.array([1.0]),
    }  # fmt: skip
    clock = TimeBase("sensor", 2e-5, False, {"gyro.scale.x": 2e-5, "gyro.scale.y": 2e-5})
    run_folder.save(
        dataclasses.replace(result, clock=clock, tables=result.tables | {"left_out": left}), folder
    )
    return folder


def write_files(home: Path) -> None:
    """Write the files of the laboratory and of the job."""
    (home / "laboratory.toml").write_text(LABORATORY)
    (home / "job.toml").write_text(JOB)


def make_laboratory(home: Path, **changes: Any) -> tuple[Path, Path, Path]:
    """Return run folder, file of the laboratory and file of the job, in `home`."""
    write_files(home)
    return make_run(home / "run", **changes), home / "laboratory.toml", home / "job.toml"


@cache
def _key(holder: str, kind: str, first: int, last: int) -> tuple[bytes, bytes]:
    """Return PKCS#12 and PEM of a key that is valid between two days from now."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec, rsa
    from cryptography.hazmat.primitives.serialization import pkcs12
    from cryptography.x509.oid import NameOID

    key: Any = ec.generate_private_key(ec.SECP256R1()) if kind == "ec" else (
        rsa.generate_private_key(65537, 2048))  # fmt: skip
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, holder)])
    now, day = datetime.datetime.now(datetime.UTC), datetime.timedelta(days=1)
    usage = x509.KeyUsage(True, True, *[False] * 7)
    certificate = (
        x509.CertificateBuilder().subject_name(name).issuer_name(name)
        .public_key(key.public_key()).serial_number(x509.random_serial_number())
        .not_valid_before(now + first * day).not_valid_after(now + last * day)
        .add_extension(usage, critical=True).sign(key, hashes.SHA256())
    )  # fmt: skip
    secret = serialization.BestAvailableEncryption(PASSWORD.encode())
    return (
        pkcs12.serialize_key_and_certificates(b"lab", key, certificate, None, secret),
        certificate.public_bytes(serialization.Encoding.PEM),
    )


def make_key(
    home: Path, holder: str = "Pendulum Calibration Laboratory", kind: str = "rsa",
    first: int = -1, last: int = 365,
) -> tuple[Path, Path]:  # fmt: skip
    """Write a key that is valid from `first` to `last` days from now, and its certificate."""
    p12, pem = _key(holder, kind, first, last)
    (home / "laboratory.p12").write_bytes(p12)
    (home / "laboratory.pem").write_bytes(pem)
    return home / "laboratory.p12", home / "laboratory.pem"


def make_certificate(home: Path, more: str = "", **about: Any) -> Certificate:
    """Gather a certificate in `home`, with one more file laid over the others."""
    run, *files = make_laboratory(home)
    (home / "more.toml").write_text(more or "[certificate]\n")
    raw = said.read([*files, home / "more.toml"])
    return gathered(run, raw, issued=DAY, **about)


TOLERANCE = '"accel.bias" = "60 mg"\n"accel.scale" = "6000 ppm"\n'


def make_conforming(home: Path, rule: str, text: str = TOLERANCE) -> Certificate:
    (home / "limits.toml").write_text(text)
    return make_certificate(home, "[certificate.conformity]\nspecification = 'data sheet'\n"
              f"tolerance = 'limits.toml'\nrule = '{rule}'\n")  # fmt: skip


def make_full(home: Path) -> Certificate:
    """Return a certificate with all that one can have."""
    make_run(home / "before", seed=8)
    (home / "limits.toml").write_text('"accel.bias" = "60 mg"\n"accel.scale" = "6000 ppm"\n')
    more = """
[certificate]
performed_until = 2025-03-15
opinions = "steady"
from_customer = "rates of the table"
external = "temperature of the hall"
next_due = "2026-03, as agreed"
[certificate.laboratory]
accreditation = "K-0042"
phone = "+33 1"
[certificate.item]
customer_id = "AW-7"
[certificate.place]
kind = "customer"
words = "hangar 4"
[certificate.conditions]
pressure = "1013 hPa"
more = "no traffic"
[certificate.adjustment]
done = "adjusted"
words = "trimmed"
before = "before"
[certificate.conformity]
specification = "data sheet"
tolerance = "limits.toml"
"""
    replaced = Replaced(number="2025-0042-r1", sha256="0" * 64, change="the customer's name")
    made = make_certificate(home, more, replaces=replaced, entry="1" * 64)
    return made.model_copy(update={"review": REVIEW})
