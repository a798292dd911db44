"""The one command, `weld-force`: a module for each command."""
