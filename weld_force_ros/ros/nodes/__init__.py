"""The nodes, and what each of them alone uses."""
