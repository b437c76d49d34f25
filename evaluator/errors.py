"""Errors caused by user input or by the disk."""


class InputError(ValueError):
    """A file or command line cannot be used; the message is one sentence: file, place, what was found, what to do."""


class UnwritableError(InputError):
    """A result cannot be written; no recording is at fault, and earlier files are complete."""
