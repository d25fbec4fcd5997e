"""Detection, estimation and guidance of a recording or a live source.

What may enter: a way of running.
"""

# Import each from its own module, so that a subcommand loads only what it needs.
