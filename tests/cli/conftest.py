"""What the tests of the command line need beside the package."""

from importlib.util import find_spec

# It runs every command, those of the extra `campaign` among them, which lowest versions go without.
collect_ignore = [] if find_spec("zarr") else ["test_width.py"]
