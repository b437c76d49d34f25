"""The self-test: the accuracy claims of this version, checked on the user's machine."""
