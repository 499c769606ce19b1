"""The command line: parse, call, print. Nothing is computed here."""

from __future__ import annotations

from foucault.cli.app import app, main

__all__ = ["app", "main"]
