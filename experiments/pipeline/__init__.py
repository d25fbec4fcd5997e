"""Detection, estimation and guidance for a recording or a live source.

A new way of running the filter belongs here.
"""

# Import names from the modules themselves, so that a subcommand loads only what it needs.
