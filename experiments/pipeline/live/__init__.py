"""The live loop: frames or marks as they arrive, advice on a needle, and output during the run.

Each is imported from its own module.
"""
