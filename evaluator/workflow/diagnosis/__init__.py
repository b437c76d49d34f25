"""The diagnosis of experiment files: one or several, and whether an earlier one still holds."""
