"""A real browser; tests that use it are skipped, with the reason, where there is none."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
WAITS_MS = 60_000  # for what a page shows; six times as slow a processor needed 20 s, compiling apart
DEFECT = re.compile(r"Content Security Policy|^(Reference|Type|Range|Syntax)Error")  # in the console
OpenPage = Callable[..., AbstractContextManager[Any]]


def needs_browser() -> list[pytest.MarkDecorator]:
    """Marks of a test module."""
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        return [pytest.mark.skip(reason="playwright is not installed (turnscope[test])")]
    return [pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")]


@contextmanager
def pages() -> Iterator[OpenPage]:
    """What opens a page of a link; each has a profile of its own, the browser is started once."""
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=WAITS_MS)
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield lambda link, **options: _page_of(browser, link, **options)
        browser.close()


@contextmanager
def _page_of(browser: Any, link: str, width: int = 1440, color_scheme: str = "light") -> Iterator[Any]:
    """A page; an error of its scripts, or anything its policy forbids, fails the test."""
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=color_scheme)
    try:
        page, faults = context.new_page(), []
        page.set_default_timeout(WAITS_MS)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("console", lambda line: faults.append(line.text) if DEFECT.search(line.text) else None)
        page.goto(link)
        try:
            yield page
        except Exception as error:
            error.add_note(f"faults of the page: {faults}")
            raise
    finally:
        context.close()
    assert faults == []
