"""The command group: names and one-line helps without importing a single command."""

from __future__ import annotations

import os
from importlib import import_module

import click

from evaluator.cli.checked import checked

# Section of the help: command: (module with a click command of that name, dashes as underscores; one-line help).
SECTIONS = {
    "First steps": {
        "demo": ("first_steps.demo", "Run the whole pipeline on the shipped sample videos."),
        "studio": ("first_steps.studio", "Open the studio: calibrate, edit, inspect and diagnose in the browser."),
        "new": ("first_steps.new", "Write commented templates for a new experiment."),
        "check": ("first_steps.check", "Validate all files of an experiment."),
        "selftest": ("first_steps.selftest", "Check the accuracy claims of this version on this machine."),
    },
    "Camera": {
        "gauge": ("camera.gauge", "Write a printable dot gauge in true scale."),
        "calibrate": ("camera.calibrate", "Calibrate the camera from images of a dot gauge."),
        "check-camera": ("camera.calibrate", "Check whether a calibration still holds."),
        "dots": ("camera.calibrate", "Find and index the dots in an image, without a gauge file."),
        "record": ("camera.record", "Record a camera with time stamps and the start time of the motors."),
    },
    "Measurement": {
        "track": ("measurement.track", "Track the marks of one recording."),
        "turning": ("measurement.turning", "Measure the turning radius from tables of marks or poses."),
        "analyze": ("measurement.analyze", "Track every run of an experiment and measure its turning radius."),
        "circular-test": ("measurement.circular_test", "Evaluate a steady-state circular test: understeer gradient."),
        "trends": ("measurement.trends", "Compare several sessions of one robot over time."),
    },
    "Experiment and simulation": {
        "plan": ("experiment.plan", "Plan the runs of an experiment and what they can detect."),
        "compare": ("experiment.compare", "Compare every run with its simulation."),
        "report": ("experiment.report", "Write the HTML report of an experiment."),
        "diagnose": ("experiment.diagnose", "Find the physical effect that the model lacks."),
        "export": ("experiment.export", "Write the results as JSON and netCDF, with provenance."),
    },
    "Simulation": {
        "simulate": ("simulation.simulate", "Simulate one run."),
        "steady": ("simulation.steady", "Tabulate steady turning radii over speeds and ratios."),
        "sweep": ("simulation.sweep", "Simulate parameter grids and random samples."),
        "render": ("simulation.render", "Render the video of a simulated run, with exact truth."),
        "effects": ("simulation.effects", "List the physical effects, describe one, or begin your own."),
        "slip-bench": ("simulation.slip_bench", "Fit a slip law to torques of a slip test bench."),
        "paper": ("simulation.paper", "Recompute every published figure and number."),
        "export-robot": ("simulation.export_robot", "Export a robot to MuJoCo or Gazebo and list what is lost."),
    },
}
COMMANDS = {name: entry for section in SECTIONS.values() for name, entry in section.items()}


class LazyGroup(click.Group):
    """A group whose commands are imported when they run."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All command names, section by section."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command; None where there is no such command."""
        del ctx
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"evaluator.cli.{COMMANDS[cmd_name][0]}")
        command: click.Command = getattr(module, cmd_name.replace("-", "_"))
        return checked(command)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Add the nearest command to the message for a misspelt one."""
        if args and not args[0].startswith("-") and args[0] not in COMMANDS:
            import difflib

            near = difflib.get_close_matches(args[0], COMMANDS, n=1)
            ctx.fail(f"no such command: {args[0]}" + (f"; did you mean {near[0]}?" if near else ""))
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections from the table, importing nothing; texts of all sections begin in one column."""
        del ctx
        widest = max(map(len, COMMANDS))
        for title, commands in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(widest), text) for name, (_, text) in commands.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="turnscope")
@click.option(
    "--sandbox",
    type=click.Path(exists=True, file_okay=False, resolve_path=True),
    metavar="FOLDER",
    help="For files of unknown origin: refuse files outside of FOLDER that an experiment, a scene or a sweep names.",
)
def turnscope(sandbox: str | None) -> None:
    """Measure how a skid-steered robot turns, and find out why it does not turn as the model predicts."""
    if sandbox is not None:  # read by simulator.files.named, whose import a help text need not wait for
        os.environ["TURNSCOPE_SANDBOX"] = sandbox
