"""From experiment.toml to tables: every run tracked, fitted and simulated, in parallel and resumable."""

from evaluator.workflow.analysis import Analysis, analyze, plan
from evaluator.workflow.outputs import Outputs

__all__ = ["Analysis", "Outputs", "analyze", "plan"]
