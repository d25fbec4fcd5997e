"""Moving bodies simulated with MuJoCo: truths that do not come from the equations of this project.

MuJoCo comes with the `dev` extra. Each body is a `Body`: a user's description of it, and its motion.
"""
