"""What the README and the documents beside the code show is true: code runs, links lead somewhere, commands exist."""

from __future__ import annotations

import importlib
import re
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import click
import pytest

from evaluator.cli.group import turnscope

ROOT = Path(__file__).parents[2]
FOLDERS = ("calibration", "simulator", "evaluator", "sample_videos", "tests/benchmarks", "tests/benchmarks/tracking")
NAMES = ("README.md", *(f"{folder}/README.md" for folder in FOLDERS), "tests/benchmarks/diagnosis.md")
DOCUMENTS = {name: ROOT / name for name in NAMES}
TEXTS = {name: path.read_text(encoding="utf-8") for name, path in DOCUMENTS.items()}
MOST_WORDS = 600  # one to two screens


def blocks(text: str, language: str) -> list[str]:
    """Code blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


EXAMPLES = {
    f"{name}-{number}": code
    for name, text in TEXTS.items()
    for number, code in enumerate(blocks(text, "python"), start=1)
}
COMMAND_LINES = [
    (name, part.strip())
    for name, text in TEXTS.items()
    for block in blocks(text, "(?:sh|powershell)")
    for line in block.splitlines()
    for part in re.split(r"&&|;|(?<!\S)#.*", line)
    if re.match(r"\S*turnscope ", part.strip())
]
EVERY_TEXT = "\n".join(TEXTS.values())
MODULES = sorted(
    {f"tests.benchmarks.{name}" for name in re.findall(r"`bench ([a-z_.]+)", EVERY_TEXT)}
    | set(re.findall(r"python -m (tests\.[a-z_.]*[a-z])", EVERY_TEXT))
)


def test_readme_fits_on_two_screens() -> None:
    assert len(TEXTS["README.md"].split()) <= MOST_WORDS


def test_every_package_shows_an_example() -> None:
    assert {name.partition("/")[0] for name in EXAMPLES} >= {"calibration", "simulator", "evaluator"}


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_runs_and_prints(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(EXAMPLES[name], f"example {name}", "exec"), {})  # noqa: S102 - our own documents
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("name", DOCUMENTS)
def test_local_links_and_images_lead_somewhere(name: str) -> None:
    text = re.sub(r"```.*?```", "", TEXTS[name], flags=re.DOTALL)
    targets = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text)
    missing = [
        target
        for target in targets
        if not target.startswith(("https://", "http://")) and not leads_somewhere(DOCUMENTS[name], target)
    ]
    assert not missing


def leads_somewhere(document: Path, target: str) -> bool:
    """Whether the file of a link exists, and in it the heading that the link names."""
    path, _, anchor = target.partition("#")
    file = (document.parent / path) if path else document
    if not file.exists():
        return False
    headings = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), flags=re.MULTILINE) if anchor else []
    return not anchor or anchor in [re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in headings]


@pytest.mark.parametrize(("name", "line"), COMMAND_LINES)
def test_every_command_line_names_a_command_and_its_options(name: str, line: str) -> None:
    words = shlex.split(line)[1:]
    group = click.Context(turnscope)
    command = turnscope.get_command(group, words[0])
    assert command is not None, f"{name}: {line}"
    known = {option for parameter in command.get_params(group) for option in parameter.opts + parameter.secondary_opts}
    assert {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)} <= known, f"{name}: {line}"


def test_every_benchmark_that_is_named_exists() -> None:
    assert [module for module in MODULES if find_spec(module) is None] == []


@pytest.mark.parametrize("package", ["calibration", "simulator", "evaluator"])
def test_every_public_name_is_there_and_importing_the_package_is_light(package: str) -> None:
    code = f"import sys, {package}; assert not {{'numpy', 'pandas', 'numba'}} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    module = importlib.import_module(package)
    assert all(hasattr(module, name) for name in module.__all__)


def test_help_loads_none_of_the_libraries_that_take_a_tenth_of_a_second() -> None:
    code = (
        "import atexit, sys; sys.argv = ['turnscope', '--help']; "
        "atexit.register(lambda: print({'numpy', 'pandas', 'numba', 'pydantic'} & set(sys.modules), file=sys.stderr)); "
        "from evaluator.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.strip()) == (0, "set()")
