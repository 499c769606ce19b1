"""Units that are often met, as pint has them: `python tests/make_units.py` writes them anew."""

from __future__ import annotations

import json
import re
from pathlib import Path

from foucault import units
from foucault.files import write_text

OFTEN = """deg deg/s deg/h rad/s rad g mg ug m/s^2 m/s m mm cm km s ms us ns min h Hz kHz ppm
% percent arcsec arcmin mrad urad count K uT nT mG rpm rev dps deg/s/sqrt(Hz) deg/h/sqrt(Hz) rad/s^2
m/s/sqrt(h) m/s/sqrt(Hz) mg/sqrt(Hz) deg/s^2/sqrt(Hz) m/s^3/sqrt(Hz) deg/sqrt(s) ug/sqrt(s)
count/g count/(deg/s) count/mg count/(m/s^2) count/(rad/s) arcsec/s mGal arcsec/sqrt(Hz)"""
"""Beside the units of the kinds of quantity and of what is not estimated."""


def common() -> list[str]:
    """Return them, each once."""
    out = OFTEN.split()
    for kind in units.KINDS.values():
        out += [kind.si, *kind.display, kind.example.split(" ", 1)[1]]
    for table in ("left_out", "parts"):
        text = (Path(units.__file__).parent / "models" / f"{table}.toml").read_text()
        out += re.findall(r'^unit = "([^"]+)"', text, re.M)
        out += re.findall(r'(?:typical|sd|max|over) = "[-+\d.e]+ ([^"]+)"', text)
    return sorted({u for u in out if u not in units.CELSIUS and u not in ("", "1")})


def main() -> None:
    rows = {unit: units._by_pint(unit) for unit in common()}
    lines = [f"{json.dumps(k)}: {json.dumps(v)}" for k, v in rows.items()]
    target = Path(units.__file__).with_name("units_common.json")
    write_text(target, "{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
