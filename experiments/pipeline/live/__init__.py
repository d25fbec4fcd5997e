"""The live loop: frames or marks as they come, advice on a needle, and what is written meanwhile.

Each is imported from its own module.
"""
