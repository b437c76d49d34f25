"""From poses to turning: steady turn, smallest sustained radius, speeds, each with an interval that holds."""

from evaluator.turning.measure import Turning, measure_turning

__all__ = ["Turning", "measure_turning"]
