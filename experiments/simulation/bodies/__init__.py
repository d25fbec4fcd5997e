"""Moving bodies simulated with MuJoCo: true motions that do not follow from the equations of this project.

MuJoCo comes with the `dev` extra. A `Body` has a user's description of the body, and its true motion.
"""
