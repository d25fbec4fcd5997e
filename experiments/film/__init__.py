"""Films of what the camera saw: estimates, marks, reasons.

Another drawing belongs here.
"""

# Import each from its own module.
