"""The package as researchers use it: arrays in, xarray and pandas out, under the names of `weld_force_ros` itself.

Nothing is computed here: every object holds a message or a definition of the layers below and hands it on, so that the
same input gives the same numbers as the command line and the nodes.
"""
