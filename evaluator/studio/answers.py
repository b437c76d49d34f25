"""HTTP answers from plain functions: run in a thread, JSON result, one sentence per error."""

from __future__ import annotations

import json
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Protocol

from anyio import to_thread
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from evaluator.errors import InputError
from evaluator.files import plain
from evaluator.studio.folder import Folder
from evaluator.studio.history import History
from evaluator.studio.jobs import Jobs
from evaluator.workflow import ChangedMeanwhileError, Decoder, LiveCamera

Json = dict[str, Any]


@dataclass(frozen=True)
class Studio:
    """What all screens share."""

    folder: Folder
    jobs: Jobs
    decoder: Decoder
    history: History
    live: LiveCamera


@dataclass(frozen=True)
class Asked:
    """A request: parts of its path, its query and its body; all values are untrusted and are validated."""

    path: dict[str, str]
    query: dict[str, str]
    body: Json

    def number(self, name: str, default: float) -> float:
        """A finite number of the query. Raises InputError."""
        return number(self.query.get(name, default), name)

    def text(self, name: str) -> str:
        """A text of the body. Raises InputError."""
        value = self.body.get(name)
        if not isinstance(value, str):
            raise InputError(f"{name} is missing")
        return value


class Work(Protocol):
    """Answers a request with a JSON value or a response."""

    def __call__(self, studio: Studio, asked: Asked, /) -> Any:
        """Answer a request. Raises InputError and its subclasses."""


def number(value: Any, name: str) -> float:
    """A finite number. Raises InputError."""
    try:
        found = float(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} = {value!r} is not a number") from error
    if not math.isfinite(found):
        raise InputError(f"{name} must be finite")
    return found


def endpoint(studio: Studio, work: Work) -> Callable[[Request], Awaitable[Response]]:
    """The function of a route."""

    async def answer(request: Request) -> Response:
        body: Json = {}
        if request.method not in ("GET", "HEAD"):
            try:
                body = json.loads(await request.body() or b"{}")
            except (ValueError, RecursionError):
                return _refused("the request is not JSON", 400)
            if not isinstance(body, dict):
                return _refused("the request must be a JSON object", 400)
        asked = Asked(dict(request.path_params), dict(request.query_params), body)
        return await to_thread.run_sync(_answered, studio, work, asked)

    return answer


def _answered(studio: Studio, work: Work, asked: Asked) -> Response:
    from calibration.errors import CalibrationError
    from simulator.errors import SimulationError

    try:
        found = work(studio, asked)
    except ChangedMeanwhileError as error:
        return _refused(str(error), 409)
    except (InputError, CalibrationError, SimulationError) as error:
        return _refused(_without_root(studio, str(error)), 400)
    except OSError as error:
        return _refused(f"{error.filename or 'a file'}: {error.strerror}", 400)
    except Exception as error:  # noqa: BLE001 - reported in the page, with the traceback on the terminal
        import traceback

        traceback.print_exc()
        return _refused(f"unexpected {type(error).__name__}: {error}; please report this", 500)
    return found if isinstance(found, Response) else JSONResponse(plain(found))


def _without_root(studio: Studio, sentence: str) -> str:
    """A sentence with paths relative to the folder: shorter, and equal on every machine."""
    return sentence.replace(f"{studio.folder.root}/", "")


def _refused(sentence: str, status: int) -> Response:
    return JSONResponse({"error": sentence}, status)
