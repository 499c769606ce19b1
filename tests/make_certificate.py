"""A laboratory with a run to certify: its files, its key, and certificates of it."""

from __future__ import annotations

import dataclasses
import datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from foucault import run_folder
from foucault.result import TimeBase
from make_result import make_result

PASSWORD = "geheim"

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


def make_laboratory(home: Path, **changes: Any) -> tuple[Path, Path, Path]:
    """Return run folder, file of the laboratory and file of the job, in `home`."""
    (home / "laboratory.toml").write_text(LABORATORY)
    (home / "job.toml").write_text(JOB)
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
