from .measure import measure_turning as measure_turning
from .quantities import RobotShape as RobotShape
from .result import Turning as Turning
from .result import only_mark as only_mark
