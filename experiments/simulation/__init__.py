"""Simulated worlds: truth and films of scenarios, a camera before the phantom, closed-loop insertion.

What may enter: what makes truth. No filter is scored here.
"""
