"""Truth and films of scenarios, a camera in front of the phantom, closed-loop insertion.

New sources of truth belong here; scores do not.
"""

# Import names from the modules themselves: the phantom's process has to start before anything else is loaded.
