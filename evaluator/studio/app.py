"""The application: routes of all screens, the page itself, and the guard around them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from importlib.resources import files
from pathlib import Path
from threading import Thread

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from evaluator.errors import InputError
from evaluator.studio.answers import Studio
from evaluator.studio.folder import Folder
from evaluator.studio.history import History
from evaluator.studio.jobs import Jobs
from evaluator.studio.routes import findings, home, live, own_effects, rig, runs, undo, values
from evaluator.studio.security import Guard, Secrets
from evaluator.workflow import Decoder, LiveCamera

STATIC = Path(str(files("evaluator.studio") / "static"))


def application(root: Path, port: int, secrets: Secrets, *, prepared: bool = False) -> Guard:
    """The studio of a folder, as an ASGI application. Raises OSError if the folder does not exist.

    prepared: whether the detection of dots is loaded in advance, which takes half a second of processor time.
    """
    folder = Folder(root)
    studio = Studio(folder, Jobs(folder), Decoder(), History(), LiveCamera())

    @asynccontextmanager
    async def living(_: Starlette) -> AsyncIterator[None]:
        studio.jobs.start()
        # Not needed before the first request.
        Thread(target=_make_ready, args=(studio.decoder, prepared), daemon=True).start()
        yield
        studio.jobs.close()
        studio.decoder.close()
        studio.live.close()

    routes = [
        Route("/", _page),
        Mount("/static", StaticFiles(directory=STATIC)),
        *home.routes(studio),
        *runs.routes(studio),
        *findings.routes(studio),
        *own_effects.routes(studio),
        *rig.routes(studio),
        *live.routes(studio),
        *values.routes(studio),
        *undo.routes(studio),
    ]
    app = Starlette(routes=routes, lifespan=living, exception_handlers={404: _nothing, 405: _nothing})
    return Guard(app, port, secrets)


def _make_ready(decoder: Decoder, prepared: bool) -> None:
    decoder.start()
    if prepared:
        with suppress(InputError):  # the studio has been closed meanwhile
            decoder.prepare()


async def _page(request: Request) -> Response:
    del request
    return FileResponse(STATIC / "index.html", media_type="text/html")


async def _nothing(request: Request, error: Exception) -> Response:
    del request, error
    return PlainTextResponse("There is nothing here.\n", 404)
