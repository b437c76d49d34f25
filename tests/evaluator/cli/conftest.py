"""A function of ours replaced by one that notes how it is called."""

from __future__ import annotations

from typing import Any

import pytest

from tests.evaluator.cli.called import Called


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Puts a noted function in the place of one of ours."""

    def put(name: str, result: Any = None) -> Called:
        called = Called(result)
        monkeypatch.setattr(name, called)
        return called

    return put
