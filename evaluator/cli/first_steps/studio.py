"""`turnscope studio`: calibrate, edit, inspect and diagnose in the browser."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH

NEEDED = ("starlette", "uvicorn", "tomlkit")


@click.command(epilog="\b\nExamples:\n  turnscope studio\n  turnscope studio monday/ --port 8123 --no-browser")
@click.argument("folder", type=PATH, default=Path())
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port to listen on. [default: any that is free]")
@click.option("--browser/--no-browser", default=True, show_default=True, help="Open the studio in the browser.")
def studio(folder: Path, port: int, browser: bool) -> None:
    """Open the studio on FOLDER: a local web page for cameras, experiments, runs, results and diagnosis.

    It reads and writes the same files as the other commands. It listens on this machine only, and only the browser
    that opens the printed link has access. Ctrl+C ends it; unfinished work continues at the next start.
    """
    from importlib.util import find_spec

    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise click.ClickException(
            f"the studio needs {', '.join(missing)}; install with: pip install 'turnscope[studio]'"
        )
    if not folder.is_dir():
        raise click.ClickException(f"{folder}: no such folder; expected the folder of your recordings")
    from evaluator.studio.server import serve

    def opened(link: str) -> None:
        click.echo(f"The studio is open at\n  {link}\nCtrl+C ends it.")
        if browser:
            import webbrowser

            click.launch(link) if not webbrowser.open(link) else None

    serve(folder, port, opened)
