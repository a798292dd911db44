"""Write single lines to standard error, without the terminal library that tables need."""

import sys

_notes: dict[str, None] = {}


def report_problem(error: Exception) -> None:
    """Write an error as one line."""
    sys.stderr.write("weld-force: " + " ".join(str(error).split()) + "\n")


def note_old_spelling(old: str, new: str) -> None:
    """Keep the note that something is spelt in a new way; the old one works for this release."""
    _notes[f"{old} is now spelt {new}; the old spelling goes with the next release"] = None


def print_notes() -> None:
    """Write the notes that were kept, a line each."""
    for note in _notes:
        sys.stderr.write(f"weld-force: {note}\n")
    _notes.clear()


def discard_notes() -> None:
    """Forget the notes that were kept: bad input gets one line."""
    _notes.clear()
