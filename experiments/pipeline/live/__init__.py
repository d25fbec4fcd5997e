"""The live loop: frames or marks as they arrive, advice on a needle, and output during the run.

Import names from the modules themselves.
"""
