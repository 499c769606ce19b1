"""The application: who is let in at all, how mistakes are said, and what every answer carries."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, RedirectResponse, Response
from starlette.exceptions import HTTPException

from foucault import __version__
from foucault.errors import FoucaultError, error
from foucault.report import COLOURS
from foucault.workbench import actions, api, certify, live, pages, plan
from foucault.workbench.bench import HERE, STATUS, Bench, LoginNeededError, page
from foucault.workbench.uploads import LARGEST

__all__ = ["Bench", "application"]

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

SMALL = 4 << 20
"""A form without a log is no larger [byte]."""

LOGS_SENT = ("/logs", "/api/logs", "/verify", "/api/verify")

OWN = ("localhost", "127.0.0.1", "[::1]")

HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; frame-src 'self'; form-action 'self'; "
    "base-uri 'none'; frame-ancestors 'self'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "SAMEORIGIN",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Guard:
    """Refuses what comes from elsewhere or is too large; gives every answer its headers."""

    def __init__(self, app: Any, bench: Bench) -> None:
        """Before an application."""
        self.app, self.bench = app, bench

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = {k.decode("latin-1"): v.decode("latin-1") for k, v in scope["headers"]}

        async def sent(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                there = {k for k, _ in message["headers"]}
                message["headers"] = [*map(self._below, message["headers"]), *(
                    (k.encode(), v.encode()) for k, v in HEADERS.items() if k.encode() not in there
                )]  # fmt: skip
            await send(message)

        most = LARGEST if scope["path"] in LOGS_SENT else SMALL
        try:
            problem = await asyncio.to_thread(self._refused, scope, headers, most)
        except FoucaultError as fault:  # the file of accounts cannot be read: nobody gets in
            problem = fault
        if problem is not None:
            await _plain(problem, scope)(scope, receive, sent)
            return
        size = 0

        async def received() -> MutableMapping[str, Any]:
            nonlocal size
            message = await receive()
            size += len(message.get("body", b""))
            if size > most:
                raise _large(most)
            return message

        await self.app(scope, received, sent)

    def _below(self, header: tuple[bytes, bytes]) -> tuple[bytes, bytes]:
        """Return a header of an answer; a page that it leads to is below the prefix."""
        key, value = header
        leads = key == b"location" and value.startswith(b"/")
        return key, self.bench.prefix.encode() + value if leads else value

    def _refused(self, scope: Scope, headers: dict[str, str], most: int) -> FoucaultError | None:
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > most:
            return _large(most)
        name, _, port = headers.get("host", "").rpartition(":")
        host = name if port.isdigit() else headers.get("host", "")
        through = any(k in headers for k in ("forwarded", "x-forwarded-for", "x-real-ip"))
        alone = not self.bench.people.any()
        if alone and (host not in OWN or through):
            return error("workbench.foreign")
        if scope["path"].startswith("/api/") and scope["path"] != "/api/openapi.json":
            kind, _, token = headers.get("authorization", "").partition(" ")
            if not alone or self.bench.open_to_others:  # before anything is read
                address = (scope.get("client") or ("",))[0]
                given = token.strip() if kind.lower() == "bearer" else ""
                if not given or self.bench.people.of_token(given, address) is None:
                    return error("workbench.token")
        if scope["method"] not in ("GET", "HEAD", "OPTIONS"):
            # A page of another site may send a form here, but not hide where it is from.
            origin = headers.get("origin", "")
            site = headers.get("sec-fetch-site", "same-origin")
            same = origin.partition("://")[2] == headers.get("host", "")
            if (origin and not same) or site not in ("same-origin", "none"):
                return error("workbench.form")
        return None


def _large(most: int) -> FoucaultError:
    return error("workbench.large", most=f"{most >> 20} MB")


def _plain(problem: FoucaultError, scope: Scope) -> Response:
    """Return an error as JSON to a program, as text to a person: no page, nobody is known yet."""
    status = STATUS.get(problem.code, 400)
    if scope["path"].startswith("/api/"):
        return JSONResponse(as_json(problem), status)
    return Response(f"{problem.message}\n{problem.cure}\n", status,
                    media_type="text/plain; charset=utf-8")  # fmt: skip


def as_json(problem: FoucaultError) -> dict[str, Any]:
    """Return an error as the command line has it in JSON."""
    return {"error": {"code": problem.code, "message": problem.message, "cure": problem.cure}}


def application(bench: Bench) -> Any:
    """Return the application of a workbench."""
    app = FastAPI(
        title="Foucault workbench", version=__version__, docs_url=None, redoc_url=None,
        openapi_url="/api/openapi.json", swagger_ui_oauth2_redirect_url=None,
        description="Send a log, follow the job, fetch the result.",
    )  # fmt: skip
    app.state.bench = bench
    for some in (pages, actions, certify, plan, live):
        app.include_router(some.router, include_in_schema=False)
    app.include_router(api.router)

    @app.get("/static/{name}", include_in_schema=False)
    def static(name: str) -> FileResponse:
        kinds = {"js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
        file = COLOURS if name == COLOURS.name else HERE / "static" / name
        if file.parent not in (HERE / "static", COLOURS.parent) or not file.is_file():
            raise HTTPException(404)
        kind = kinds.get(file.suffix[1:], "text/plain")
        return FileResponse(file, media_type=kind, headers={"cache-control": "max-age=3600"})

    @app.exception_handler(FoucaultError)
    def in_words(request: Request, problem: FoucaultError) -> Response:
        status = STATUS.get(problem.code, 400)
        if request.url.path.startswith("/api/"):
            return JSONResponse(as_json(problem), status)
        return page(request, "problem.html", status, message=problem.message, cure=problem.cure)

    @app.exception_handler(Exception)
    def fault(request: Request, problem: Exception) -> Response:
        code = error("workbench.fault", kind=type(problem).__name__)
        if request.url.path.startswith("/api/"):
            return JSONResponse(as_json(code), 500)
        return page(request, "problem.html", 500, message=code.message, cure=code.cure)

    @app.exception_handler(LoginNeededError)
    def log_in(request: Request, _: LoginNeededError) -> Response:
        back = request.url.path if request.method == "GET" else "/"
        return RedirectResponse(f"/login?to={back}", 303)

    @app.exception_handler(RequestValidationError)
    @app.exception_handler(HTTPException)
    def unknown(request: Request, problem: Exception) -> Response:
        status = getattr(problem, "status_code", 400)
        said = {404: "There is no such page.", 405: "This cannot be done there."}
        message = said.get(status, "This cannot be read: " + _first(problem))
        if request.url.path.startswith("/api/"):
            parts = {"code": "http", "message": message, "cure": "Look at /api/openapi.json."}
            return JSONResponse({"error": parts}, status)
        return page(request, "problem.html", status, message=message, cure="Begin at the start.")

    return Guard(app, bench)


def _first(problem: Exception) -> str:
    errors = getattr(problem, "errors", None)
    if callable(errors):
        one = errors()[0]
        return f"{one['loc'][-1]}: {one['msg']}."
    return str(getattr(problem, "detail", problem))[:200]
