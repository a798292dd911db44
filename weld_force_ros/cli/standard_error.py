"""Write single lines to standard error, without the terminal library that tables need."""

import sys


def report_problem(error: Exception) -> None:
    """Write an error as one line."""
    sys.stderr.write("weld-force: " + " ".join(str(error).split()) + "\n")


def note_old_spelling(old: str, new: str) -> None:
    """Write that something is spelt in a new way; the old one works for this release."""
    sys.stderr.write(f"weld-force: {old} is now spelt {new}; the old spelling goes with the next release\n")
