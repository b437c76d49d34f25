"""From poses to turning: steady turn, smallest sustained radius, speeds, each with an interval that holds."""

from evaluator.turning.measure import measure_turning
from evaluator.turning.quantities import RobotShape
from evaluator.turning.result import Turning

__all__ = ["RobotShape", "Turning", "measure_turning"]
