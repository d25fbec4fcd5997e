"""True motion, films and marks of scenarios; the phantom's camera; closed-loop insertion.

New simulated motions belong here; the evaluation of estimates does not.
"""

# Import names from the modules themselves: the phantom's process has to start before anything else is loaded.
