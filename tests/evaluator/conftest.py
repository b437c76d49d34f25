from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.evaluator.browser import OpenPage, pages


@pytest.fixture(scope="module")
def open_page() -> Iterator[OpenPage]:
    """A browser for the tests of a module (see pages): to start one costs more than most of them."""
    with pages() as found:
        yield found
