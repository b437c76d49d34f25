"""The one error a user of this package can cause."""


class InputError(ValueError):
    """A file or command line cannot be used; the message is one sentence: file, place, what was found, what to do."""
