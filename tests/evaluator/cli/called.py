"""Commands without their work: what they call is noted, and gives what it was told to."""

from __future__ import annotations

from typing import Any

from click.testing import CliRunner, Result

from evaluator.cli.group import turnscope


def run(*words: str) -> Result:
    """A command of turnscope with its status as return value; an error is its exception."""
    return CliRunner().invoke(turnscope, words, standalone_mode=False)


class Called(list[tuple[tuple[Any, ...], dict[str, Any]]]):
    """A function that notes how it is called, and gives what it was told to."""

    def __init__(self, result: Any) -> None:
        super().__init__()
        self.result = result

    def __call__(self, *given: Any, **named: Any) -> Any:
        named.pop("progress", None)
        self.append((given, named))
        return self.result
