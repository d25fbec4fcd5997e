"""Truth and films of scenarios, a camera in front of the phantom, closed-loop insertion.

Sources of truth belong here, scores do not.
"""

# Import each from its own module: the phantom's process has to begin before anything else is loaded.
