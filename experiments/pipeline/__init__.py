"""What runs a recording or a live source through detection, estimation and guidance.

What may enter: a way of running; mathematics belongs to the packages below. Each is imported from its own module, so
that a subcommand loads only what it needs.
"""
