"""For all tests: property-based ones draw the same examples in every run, so that a red run is a changed line."""

from hypothesis import settings

settings.register_profile("softaim", derandomize=True, deadline=None)
settings.load_profile("softaim")
