"""Simulated worlds: truth and films of scenarios, a camera before the phantom, closed-loop insertion.

What may enter: what makes truth. No filter is scored here. Each is imported from its own module, so that the phantom's
process is begun before anything else is loaded.
"""
