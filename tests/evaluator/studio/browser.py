"""A real browser on a studio; tests that use it are skipped, with the reason, where there is none."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


def needs_browser() -> list[pytest.MarkDecorator]:
    """Marks of a test module."""
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        return [pytest.mark.skip(reason="playwright is not installed (turnscope[test])")]
    return [pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")]


@contextmanager
def page_of(link: str) -> Iterator[Any]:
    """A page of the studio; an error of its scripts, or anything its policy forbids, fails the test."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        context = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="light")
        page, faults = context.new_page(), []
        page.set_default_timeout(30_000)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("console", lambda line: faults.append(line.text) if "Content Security Policy" in line.text else None)
        page.goto(link)
        yield page
        browser.close()
    assert faults == []
