"""The one error a user of this package can cause."""


class SimulationError(ValueError):
    """A robot, command or scene cannot be simulated; the message says what was found and what to do."""
