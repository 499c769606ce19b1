"""Who may do what: accounts with roles, sessions, tokens of programs, and how often one may try.

On this computer alone, without accounts, everybody is its user and may do everything. As soon as
there is an account everybody has to have one, wherever they come from.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

from foucault.errors import FoucaultError, error
from foucault.records import store as records
from foucault.records.entries import Account
from foucault.workbench.store import Store, now

ROLES = ("operator", "reviewer", "administrator")
"""Each may do what those before may."""

LASTS = 12 * 3600.0
"""A session ends after so long [s]."""

ATTEMPTS, WINDOW = 5, 300.0
"""So many wrong passwords of a name, or from an address, within so long [1], [s]."""

KEPT, A_DAY, ANYWHERE = 90, 200, "elsewhere"
"""Wrong passwords are kept for so many days, from so many names and addresses of a day; those from
further ones are counted together [1]."""

LEAST, MOST = 12, 256
"""Letters of a password [1]."""

_NAME = re.compile(r"[\w][\w .@-]{0,63}")


Told = Callable[[Account], object]
"""Keeps in the journal who may do what from now on."""


def nobody(_: Account) -> None:
    """Keep nothing."""


@dataclass(frozen=True)
class Person:
    """Whoever asks for something."""

    name: str
    role: str
    session: str = ""  # digest of its session; empty: none

    def may(self, role: str) -> bool:
        """Whether this person may do what needs a role."""
        return ROLES.index(self.role) >= ROLES.index(role)


def user() -> Person:
    """Return the user of this computer."""
    return Person(records.user(), "administrator")


@cache
def _hasher() -> Any:
    from argon2 import PasswordHasher

    return PasswordHasher()


@cache
def _nobody() -> str:
    """A hash that no password has, so that a wrong name takes as long as a wrong password."""
    made: str = _hasher().hash(secrets.token_hex(16))
    return made


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()


class People:
    """The accounts of a workbench."""

    def __init__(self, store: Store) -> None:
        """Of this file."""
        self.store = store

    def any(self) -> bool:
        """Whether there is an account."""
        with self.store.reading() as db:
            return db.execute("SELECT 1 FROM account LIMIT 1").fetchone() is not None

    def all(self) -> list[dict[str, Any]]:
        """Return the accounts without their passwords."""
        with self.store.reading() as db:
            rows = db.execute("SELECT name, role, made, closed FROM account ORDER BY name")
            return [dict(row) for row in rows]

    def add(self, name: str, role: str, password: str, told: Told = nobody) -> None:
        """Make an account, or give one another role and password; its sessions end.

        `told` keeps that in the journal before it counts; nothing is changed where it cannot.
        """
        name = name.strip()
        if not _NAME.fullmatch(name):
            raise error("workbench.name", given=name)
        if role not in ROLES:
            raise error("workbench.role", given=role, allowed=", ".join(ROLES))
        if not LEAST <= len(password) <= MOST or password.lower() == name.lower():
            raise error("workbench.password", least=LEAST, most=MOST)
        with self.store.writing() as db:
            known = db.execute("SELECT 1 FROM account WHERE name = ?", (name,)).fetchone()
            db.execute(
                "INSERT INTO account (name, role, secret, made) VALUES (?, ?, ?, ?) ON CONFLICT "
                "(name) DO UPDATE SET role = excluded.role, secret = excluded.secret, closed = 0",
                (name, role, _hasher().hash(password), now()),
            )
            db.execute("DELETE FROM session WHERE name = ?", (name,))
            told(Account(name=name, change="changed" if known else "made", role=role))

    def close(self, name: str, told: Told = nobody) -> None:
        """Close an account; its sessions and tokens end. The last administrator stays."""
        with self.store.writing() as db:
            others = db.execute("SELECT count(*) FROM account WHERE role = 'administrator' AND "
                                "closed = 0 AND name != ?", (name,)).fetchone()[0]  # fmt: skip
            if not others:
                raise error("workbench.last", name=name)
            if db.execute("UPDATE account SET closed = 1 WHERE name = ?", (name,)).rowcount != 1:
                raise error("workbench.no_account", given=name[:64])
            db.execute("DELETE FROM session WHERE name = ?", (name,))
            told(Account(name=name, change="closed"))

    def refused(self) -> list[dict[str, Any]]:
        """Return the wrong passwords of late, newest first: of whom, from where, how many."""
        with self.store.reading() as db:
            rows = db.execute("SELECT * FROM refused ORDER BY last DESC LIMIT 200")
            return [dict(row) for row in rows]

    def _refuse(self, name: str, address: str, locked: bool, told: Told) -> None:
        """Keep that somebody gave a wrong password; a name without an account may be one itself.

        `told` keeps in the journal once a day that an account is `locked`.
        """
        day, at = now()[:10], now()
        with self.store.writing() as db:
            row = db.execute("SELECT name FROM account WHERE name = ?", (name.strip(),)).fetchone()
            whose = "" if row is None else str(row["name"])
            before = db.execute("SELECT max(locked) FROM refused WHERE day = ? AND name = ?",
                                (day, whose)).fetchone()[0]  # fmt: skip
            known = db.execute("SELECT 1 FROM refused WHERE day = ? AND name = ? AND address = ?",
                               (day, whose, address)).fetchone()  # fmt: skip
            count = db.execute("SELECT count(*) FROM refused WHERE day = ?", (day,)).fetchone()[0]
            where = address if known or count < A_DAY else ANYWHERE
            db.execute(
                "INSERT INTO refused VALUES (?, ?, ?, 1, ?, ?, ?) ON CONFLICT (day, name, address) "
                "DO UPDATE SET count = count + 1, last = excluded.last, "
                "locked = max(locked, excluded.locked)", (day, whose, where, at, at, locked),
            )  # fmt: skip
            db.execute("DELETE FROM refused WHERE day < date(?, ?)", (day, f"-{KEPT} days"))
        if whose and locked and not before:
            with suppress(FoucaultError):  # records that cannot be written let nobody in
                told(Account(name=whose, change="locked out", words=f"last from {address}"))

    def of_token(self, token: str, address: str) -> Person | None:
        """Return whose token a program gave, None for nobody's, which is kept as a wrong one."""
        found = self.who(token, "token")
        if found is None:
            self._refuse("", address[:64], False, nobody)
        return found

    def log_in(self, name: str, password: str, address: str, told: Told = nobody) -> str:
        """Return the token of a new session; raises ``workbench.login``, ``workbench.attempts``.

        `told` keeps in the journal that somebody tried too often.
        """
        try:
            return self._logged_in(name, password, address)
        except FoucaultError as problem:
            if problem.code in ("workbench.login", "workbench.attempts"):
                locked = problem.code == "workbench.attempts"
                self._refuse(name, address[:64], locked, told)
            raise

    def _logged_in(self, name: str, password: str, address: str) -> str:
        from argon2.exceptions import InvalidHashError, VerificationError

        keys = (f"name {name.strip()[:64]}", f"from {address}")
        with self.store.writing() as db:
            db.execute("DELETE FROM attempt WHERE at < ? OR at > ?",
                       (time.time() - WINDOW, time.time() + 1))  # fmt: skip
            for key, most in zip(keys, (ATTEMPTS, 4 * ATTEMPTS), strict=True):
                tried = db.execute("SELECT count(*) FROM attempt WHERE of = ?", (key,))
                if tried.fetchone()[0] >= most:
                    raise error("workbench.attempts", minutes=f"{WINDOW / 60:.0f}")
            # Counted before it is looked at, so that many at once are counted too.
            db.executemany("INSERT INTO attempt VALUES (?, ?)", [(k, time.time()) for k in keys])
            row = db.execute("SELECT name, secret FROM account WHERE name = ? AND closed = 0",
                             (name.strip(),)).fetchone()  # fmt: skip
        try:
            right = _hasher().verify(_nobody() if row is None else row["secret"], password[:MOST])
        except (VerificationError, InvalidHashError):
            right = False
        if row is None or not right:
            raise error("workbench.login")
        with self.store.writing() as db:
            db.execute("DELETE FROM attempt WHERE of = ?", (keys[0],))
        return self._session(row["name"], "browser", time.time() + LASTS)

    def token(
        self, name: str, label: str, days: float = 365.0, told: Told = nobody
    ) -> str:  # fmt: skip
        """Return a token by which a program is this person; shown once; `days`: it lasts [day]."""
        return self._session(name, "token", time.time() + days * 86400.0, label[:80], told)

    def _session(
        self, name: str, kind: str, until: float, label: str = "", told: Told = nobody
    ) -> str:  # fmt: skip
        token = secrets.token_urlsafe(32)
        with self.store.writing() as db:
            db.execute("DELETE FROM session WHERE until < ?", (time.time(),))
            db.execute("INSERT INTO session VALUES (?, ?, ?, ?, ?)",
                       (_digest(token), name, kind, until, label))  # fmt: skip
            if kind == "token":
                told(Account(name=name, change="token made", words=label))
        return token

    def tokens(self, name: str) -> list[dict[str, Any]]:
        """Return the tokens of a person, which are known by their digest alone."""
        with self.store.reading() as db:
            rows = db.execute("SELECT digest, label, until FROM session WHERE name = ? AND kind = "
                              "'token' ORDER BY until", (name,))  # fmt: skip
            return [dict(row) for row in rows]

    def log_out(self, digest: str, name: str) -> None:
        """End a session of a person."""
        with self.store.writing() as db:
            db.execute("DELETE FROM session WHERE digest = ? AND name = ?", (digest, name))

    def end_token(self, digest: str, name: str, told: Told = nobody) -> None:
        """End a token of a person."""
        with self.store.writing() as db:
            row = db.execute("DELETE FROM session WHERE digest = ? AND name = ? AND kind = 'token' "
                             "RETURNING label", (digest, name)).fetchone()  # fmt: skip
            if row is not None:
                told(Account(name=name, change="token ended", words=row["label"]))

    def who(self, token: str, kind: str) -> Person | None:
        """Return whose session a token is of, None for nobody's."""
        with self.store.reading() as db:
            row = db.execute(
                "SELECT s.digest, a.name, a.role FROM session s JOIN account a USING (name) "
                "WHERE s.digest = ? AND s.kind = ? AND s.until > ? AND a.closed = 0",
                (_digest(token), kind, time.time()),
            ).fetchone()  # fmt: skip
        return None if row is None else Person(row["name"], row["role"], row["digest"])

    def mark(self, cookie: str) -> str:
        """Return what a form has to hold to be one of ours, for whoever has a cookie."""
        return hmac.new(self.store.secret, cookie.encode(), "sha256").hexdigest()
