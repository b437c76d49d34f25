"""The error raised for invalid input to this package."""


class SimulationError(ValueError):
    """A robot, command or scene cannot be simulated; the message says what was found and what to do."""
