"""The sections of the report that show a diagnosis."""
