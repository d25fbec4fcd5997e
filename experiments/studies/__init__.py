"""Studies: one file for a published table or figure; its docstring names it and how to make it again.

Each is run as `python -m experiments.studies.NAME`, so nothing is imported here.
"""
